"""PreparedRun: an evaluation that is ready to start. Errors in its input are found here, before the first tick."""

from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.fingerprint import compute_fingerprint, read_versions
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.open_agents import PRIVILEGED, declare_agent, find_unknown_sensor
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.reference_times import find_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scoring import RunInfo, ScenarioResult, apply_reference_times
from mdrive_sumo.v2x.comm_settings import describe_comm

EPISODES_FOLDER = "episodes"
LOGS_FOLDER = "logs"
TRANSCRIPTS_FOLDER = "transcripts"
SIMULATION_LIMIT_S = 600.0
"""Wall clock of one episode without its agents [s]; only a simulator that hangs takes longer."""


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
        """Return the job that drives one of the scenarios."""
        config = self.config
        return EpisodeJob(
            suite_folder=self.suite.folder.resolve(),
            scenario=scenario.id,
            agent=config.agent.resolve(),
            seed=config.seed,
            score_mode=config.score_mode,
            options=config.options,
            recording=recording_path(self.folder, scenario.id) if config.record else None,
            transcripts=self.folder / TRANSCRIPTS_FOLDER,
            logs=None if config.agent.is_builtin else self.folder / LOGS_FOLDER,
        )

    def apply_reference_times(self, scenario: Scenario, result: ScenarioResult) -> ScenarioResult:
        """Return a result compared with the suite's present reference times, as a journal may hold an older state."""
        reference = find_reference_times(scenario, self.suite.find_folder(scenario.id))
        return apply_reference_times(result, reference, self.config.score_mode)

    def make_folders(self) -> None:
        """Create the folders that the jobs write into. Raises OSError."""
        if self.config.record:
            (self.folder / EPISODES_FOLDER).mkdir(parents=True, exist_ok=True)
        if not self.config.agent.is_builtin:
            (self.folder / LOGS_FOLDER).mkdir(parents=True, exist_ok=True)

    def limit_s(self) -> float:
        """Return the wall clock after which an episode counts as hung [s]: more than its agents may take together."""
        if self.config.agent.is_builtin:
            return SIMULATION_LIMIT_S
        most = max(len(scenario.egos) for scenario in self.scenarios)
        limits = self.config.agent.limits
        return SIMULATION_LIMIT_S + most * (2 * limits.start_s + limits.episode_s)


def prepare(config: RunConfig) -> PreparedRun:
    """Load the suite and create the agent once. Raises InputError for whatever the user has to mend."""
    suite = load_suite(config.suite)
    scenarios = suite.select(config.scenario)
    for scenario in scenarios:
        check_scenario(scenario, load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id))))
    folder = config.out or config.default_folder(suite.name)
    info = make_run_info(config, suite, _read_labels(config.agent))
    return PreparedRun(config, suite, scenarios, folder, info, compute_fingerprint(config, suite, scenarios))


def make_run_info(config: RunConfig, suite: Suite, labels: tuple[str, ...]) -> RunInfo:
    """Return the description of a run for its results."""
    info = {
        "agent": config.agent.name,
        "labels": labels,
        "agent_config": config.agent.config_hash(),
        "suite": suite.name,
        "suite_checksum": suite.checksum(),
        "seed": config.seed,
        "score_mode": config.score_mode,
        "versions": read_versions(),
        "command": config.command,
        **config.options.to_dict(),
        "comm": describe_comm(config.options.comm),
    }
    return RunInfo.model_validate(info)


def recording_path(run_folder: Path, scenario: str) -> Path:
    """Return the path at which a run keeps the recording of a scenario."""
    return run_folder / EPISODES_FOLDER / f"{scenario}.npz"


def _read_labels(agent: AgentSpec) -> tuple[str, ...]:
    """Create an agent and return its own label, and "privileged" if it declares that sensor. Raises InputError."""
    name = agent.name
    family = name.partition(":")[0]
    is_family = any(builtin.startswith(f"{family}:") for builtin in AGENTS)  # perception-swap:WHAT is no module
    if isinstance(agent.agent, str) and not agent.is_builtin and (":" not in name or is_family):
        raise InputError(f"agent {name!r}: expected {', '.join(AGENTS)}, module:Class or path.py:Class, found neither")
    try:
        declaration = declare_agent(agent.resolve())
    except AgentFailure as error:
        raise InputError(f"agent {name!r}: cannot be created: {error.text.removeprefix('InputError: ')}") from None
    if unknown := find_unknown_sensor(declaration.sensors):
        raise InputError(unknown)
    label, is_privileged = declaration.label, any(sensor.kind == PRIVILEGED for sensor in declaration.sensors)
    return (label, PRIVILEGED) if is_privileged and label != PRIVILEGED else (label,)
