"""Everything that can be wrong with an evaluation is found here, before the first tick."""

from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agent_process.remote_driver import AgentLimits
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import Hiring, declaration
from mdrive_sumo.runs.fingerprint import compute_fingerprint, read_versions, resolve_locator
from mdrive_sumo.runs.job import EpisodeJob
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.run_config import RunConfig, config_hash, default_folder
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scoring import RunInfo
from mdrive_sumo.v2x.comm_settings import describe_comm, format_comm_json

EPISODES_FOLDER = "episodes"
LOGS_FOLDER = "logs"
TRANSCRIPTS_FOLDER = "transcripts"
LIMITS = AgentLimits(reply_bytes=2**20, episode_bytes=2**30)
"""A user's own agent may use up what the contract allows: notes alone may have 200 000 characters."""
SIMULATION_LIMIT_S = 600.0
"""Wall clock for all but the agents in one episode; only a simulator that hangs takes longer."""


@dataclass(frozen=True, slots=True)
class PreparedRun:
    """An evaluation that is ready to start."""

    config: RunConfig
    suite: Suite
    scenarios: tuple[Scenario, ...]
    folder: Path
    info: RunInfo
    fingerprint: Fingerprint

    def make_job(self, scenario: Scenario) -> EpisodeJob:
        """The job that drives one of its scenarios."""
        settings = self.config
        return EpisodeJob(
            suite_folder=str(self.suite.folder.resolve()),
            scenario=scenario.id,
            agent=resolve_locator(settings.agent),
            agent_config=settings.agent_config,
            seed=settings.seed,
            score_mode=settings.score_mode,
            recording=str(recording_path(self.folder, scenario.id)) if settings.record else "",
            comm=format_comm_json(settings.comm),
            clock=settings.clock.text,
            actors=settings.actors,
            friction=settings.friction,
            transcripts=str(self.folder / TRANSCRIPTS_FOLDER),
            log_folder="" if settings.agent in AGENTS else str(self.folder / LOGS_FOLDER),
            limits=LIMITS,
        )

    def make_folders(self) -> None:
        """Makes what the jobs write into; raises OSError."""
        if self.config.record:
            (self.folder / EPISODES_FOLDER).mkdir(parents=True, exist_ok=True)
        if self.config.agent not in AGENTS:
            (self.folder / LOGS_FOLDER).mkdir(parents=True, exist_ok=True)

    def limit_s(self) -> float:
        """Wall clock after which an episode counts as hung: more than its agents may take together."""
        if self.config.agent in AGENTS:
            return SIMULATION_LIMIT_S
        most = max(len(scenario.egos) for scenario in self.scenarios)
        return SIMULATION_LIMIT_S + most * (2 * LIMITS.start_s + LIMITS.episode_s)


def prepare(settings: RunConfig) -> PreparedRun:
    """Loads the suite and tries the agent; raises InputError for whatever the user has to mend."""
    suite = load_suite(settings.suite)
    scenarios = suite.matching(settings.scenario)
    for scenario in scenarios:
        check_scenario(scenario, load_road_map(find_network_folder(scenario.network, suite.home(scenario.id))))
    info = RunInfo(
        agent=settings.agent,
        labels=_labels(settings),
        agent_config=config_hash(settings.agent_config),
        suite=suite.name,
        suite_checksum=suite.checksum(),
        seed=settings.seed,
        score_mode=settings.score_mode,
        comm=describe_comm(settings.comm),
        agent_clock=settings.clock.text,
        actors=settings.actors,
        friction=settings.friction,
        versions=read_versions(),
        command=settings.command,
    )
    folder = settings.out or default_folder(settings, suite.name)
    return PreparedRun(settings, suite, scenarios, folder, info, compute_fingerprint(settings, suite, scenarios))


def recording_path(run_folder: Path, scenario: str) -> Path:
    """Where a run keeps the episode of a scenario."""
    return run_folder / EPISODES_FOLDER / f"{scenario}.npz"


def _labels(settings: RunConfig) -> tuple[str, ...]:
    """What the agent calls itself, and "privileged" if it declares that sensor; one is made to find out."""
    agent = settings.agent
    family = agent.partition(":")[0]
    ours = any(name.startswith(f"{family}:") for name in AGENTS)  # perception-swap:WHAT is no module
    if agent not in AGENTS and (":" not in agent or ours):
        raise InputError(f"agent {agent!r}: expected {', '.join(AGENTS)}, module:Class or path.py:Class, found neither")
    try:
        found = declaration(Hiring(resolve_locator(agent), settings.agent_config, LIMITS))
    except AgentFailure as error:
        raise InputError(f"agent {agent!r}: cannot be created: {error.text.removeprefix('InputError: ')}") from None
    own, privileged = found.label, any(sensor.kind == "privileged" for sensor in found.sensors)
    return (own, "privileged") if privileged and own != "privileged" else (own,)
