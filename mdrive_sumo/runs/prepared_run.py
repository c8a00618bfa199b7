"""PreparedRun: an evaluation that is ready to start. Errors in its input are found here, before the first tick."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.agent_process.agent_file import describe_missing_class
from mdrive_sumo.agent_process.agent_lookup import is_joint_locator
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, remove_parts
from mdrive_sumo.core.plug_ins import PlugInKind, check_plug_in_names, list_plug_ins
from mdrive_sumo.core.private_paths import hide_command, hide_locator
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.agent_boxing import box_agent, list_hidden_folders
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import ATTEMPTS, EpisodeJob
from mdrive_sumo.runs.fingerprint import compute_fingerprint, identify_run_plug_ins, read_versions
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.open_agents import declare_agent, find_unknown_sensor
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.runs.run_config import RUNS_FOLDER, RunConfig, check_seeds
from mdrive_sumo.runs.run_paths import (
    CAMERAS_FOLDER,
    EPISODES_FOLDER,
    LOGS_FOLDER,
    TRANSCRIPTS_FOLDER,
    recording_path,
    seed_folder,
)
from mdrive_sumo.runs.take_actions import check_takes, complete_replay
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.reference_times import describe_stored_times, find_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scoring import EpisodeKey, RunInfo, ScenarioResult, ScoreMode, apply_reference_times, check_reference
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from mdrive_sumo.scoring.labels import ATTACKED, JOINT, PRIVILEGED, UNSANDBOXED
from mdrive_sumo.scoring.metrics.registry import load_metric_plug_ins
from mdrive_sumo.v2x.attacks.attackers import check_attackers
from mdrive_sumo.v2x.comm_settings import describe_comm
from mdrive_sumo.v2x.messages import TYPES

PACED_TICKS = 20_000
"""More ticks than the time limit of any packaged scenario: what a pace adds to the time of an episode."""
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

    @property
    def agent(self) -> AgentSpec:
        """The agent as a worker starts it. Raises InputError if it cannot run in a box but shall."""
        return _locate_agent(self.config.agent, self.config, self.suite, self.folder)

    @property
    def others(self) -> OtherAgents | None:
        """The second agent as a worker starts it, if there is one. Raises InputError as `agent` does."""
        others = self.config.others
        if others is None:
            return None
        return replace(others, agent=_locate_agent(others.agent, self.config, self.suite, self.folder))

    @property
    def episodes(self) -> dict[EpisodeKey, Scenario]:
        """The scenario of every episode, scenario by scenario with all seeds."""
        return {(scenario.id, seed): scenario for scenario in self.scenarios for seed in self.config.seeds}

    def find_key(self, result: ScenarioResult) -> EpisodeKey:
        """Return what a result is found by in `episodes`; in a run of one seed only the scenario counts."""
        return result.key if self.config.has_many_seeds else (result.id, self.config.seed)

    def name_episode(self, key: EpisodeKey) -> str:
        """Return an episode's name in messages: its scenario, and its seed if the run has several."""
        return f"{key[0]} seed {key[1]}" if self.config.has_many_seeds else key[0]

    def find_recording(self, key: EpisodeKey) -> Path:
        """Return the path at which the run keeps the recording of an episode."""
        return recording_path(self.folder, key[0], self._folder_seed(key[1]))

    def find_camera_images(self, key: EpisodeKey) -> Path:
        """Return the path at which the run keeps the camera images of an episode, if it does."""
        return seed_folder(self.folder / CAMERAS_FOLDER, self._folder_seed(key[1])) / f"{key[0]}.zip"

    def find_transcripts(self, seed: int) -> Path:
        """Return the folder of the transcripts of a seed."""
        return seed_folder(self.folder / TRANSCRIPTS_FOLDER, self._folder_seed(seed))

    def _folder_seed(self, seed: int) -> int | None:
        return seed if self.config.has_many_seeds else None

    def make_job(self, scenario: Scenario, seed: int | None = None) -> EpisodeJob:
        """Return the job that drives one of the scenarios. seed: one of the run's; None: the first."""
        config = self.config
        seed = config.seed if seed is None else seed
        logs = seed_folder(self.folder / LOGS_FOLDER, self._folder_seed(seed))
        return EpisodeJob(
            suite_folder=self.suite.folder.resolve(),
            scenario=scenario.id,
            agent=self.agent.with_pace(config.pace_ms / 1000),
            others=self.others,
            seed=seed,
            score_mode=config.score_mode,
            options=config.options,
            recording=self.find_recording((scenario.id, seed)) if config.record else None,
            record_features=config.record_features,
            transcripts=self.find_transcripts(seed),
            cameras=self.find_camera_images((scenario.id, seed)) if config.record_cameras else None,
            logs=None if config.is_builtin else logs,
            checksum=self.suite.compute_file_checksum(scenario.id),
        )

    def apply_reference_times(self, scenario: Scenario, result: ScenarioResult) -> ScenarioResult:
        """Return a result compared with the suite's present reference times, as a journal may hold an older state."""
        reference = find_reference_times(scenario, self.suite.find_folder(scenario.id))
        return apply_reference_times(result, reference, self.config.score_mode, compute_time_limit_ticks(scenario))

    def make_folders(self) -> None:
        """Create the folders that the jobs write into, without what a killed start left there. Raises OSError."""
        kinds = [EPISODES_FOLDER] if self.config.record else []
        if not self.config.is_builtin:
            kinds.append(LOGS_FOLDER)
        for kind in kinds:
            for seed in self.config.seeds:
                remove_parts(make_folder(seed_folder(self.folder / kind, self._folder_seed(seed))))
        for kind in (CAMERAS_FOLDER, TRANSCRIPTS_FOLDER):  # made only when there is something to write
            for seed in self.config.seeds:
                remove_parts(seed_folder(self.folder / kind, self._folder_seed(seed)))

    def with_config(self, config: RunConfig, labels: tuple[str, ...] | None = None) -> "PreparedRun":
        """Return the run of the same scenarios with another configuration. labels: None: those of this run."""
        return replace(
            self,
            config=config,
            folder=config.find_folder(self.suite.name),
            info=make_run_info(
                config, self.suite, self.info.labels if labels is None else labels, self.info.declared_label
            ),
            fingerprint=compute_fingerprint(config, self.suite, self.scenarios),
        )

    def limit_s(self) -> float:
        """Return the wall clock after which an episode counts as hung [s]."""
        return compute_limit_s(self.config.agents, self.scenarios, self.config.pace_ms / 1000)


def compute_limit_s(agents: Sequence[AgentSpec], scenarios: Sequence[Scenario], pace_s: float = 0.0) -> float:
    """Return the wall clock after which an episode counts as hung [s]; see `compute_job_limit_s`."""
    foreign = [agent.limits for agent in agents if not agent.is_builtin]
    return compute_job_limit_s(max(len(scenario.egos) for scenario in scenarios), foreign, pace_s)


def compute_job_limit_s(cavs: int, limits: Sequence[AgentLimits], pace_s: float = 0.0, episodes: int = 1) -> float:
    """Return the wall clock after which a job counts as hung [s]: more than its agents may take together.

    cavs: most of a scenario. limits: of agents that are not built in. episodes: that the job drives at most, each of
    them `ATTEMPTS` times.
    """
    of_agents_s = cavs * max((2 * limit.start_s + limit.episode_s for limit in limits), default=0.0)
    return episodes * (SIMULATION_LIMIT_S + ATTEMPTS * (PACED_TICKS * pace_s + of_agents_s))


def prepare(config: RunConfig) -> PreparedRun:
    """Load the suite and create the agent once. Raises InputError for whatever the user has to mend."""
    check_seeds(config.seeds)
    suite = load_suite(config.suite)
    for scenario in suite.select(config.scenario):
        check_scenario(scenario, load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id))))
    return prepare_with_suite(config, suite)


def prepare_with_suite(config: RunConfig, suite: Suite, *, is_take: bool = False) -> PreparedRun:
    """As `prepare`, with the suite of the configuration, whose scenarios are checked already.

    is_take: people drive, which no evaluation can have.
    """
    load_metric_plug_ins()  # what cannot be imported is found here, not after the first episode
    config = _complete(replace(config, chosen_mode=config.chosen_mode or ScoreMode(suite.score_mode)))
    scenarios = suite.select(config.scenario)
    if config.score_mode is ScoreMode.HARD:
        for scenario in scenarios:
            home = suite.find_folder(scenario.id)
            if not (reference := find_reference_times(scenario, home)):
                check_reference(scenario.id, reference, describe_stored_times(scenario, home))
    folder = config.find_folder(suite.name)
    if config.sandbox and config.scheduler:
        raise InputError("--sandbox: expected --executor local, found dask: a box needs the main thread of its process")
    check_mute(config, scenarios)
    check_attack(config, scenarios)
    for agent in () if is_take else config.agents:
        check_agent_name(agent)
    check_takes(config.agents, scenarios)
    declared_label, labels = declare_all_labels(
        [_locate_agent(agent, config, suite, folder) for agent in config.agents], is_sandboxed=config.sandbox
    )
    info = make_run_info(config, suite, labels, declared_label)
    return PreparedRun(config, suite, scenarios, folder, info, compute_fingerprint(config, suite, scenarios))


def _complete(config: RunConfig) -> RunConfig:
    """Return the run with the options that its agents take from elsewhere. Raises InputError."""
    others = config.others and replace(config.others, agent=complete_replay(config.others.agent))
    return replace(config, agent=complete_replay(config.agent), others=others)


def _locate_agent(agent: AgentSpec, config: RunConfig, suite: Suite, run_folder: Path) -> AgentSpec:
    """Return an agent as any process finds it, in a box if the run is sandboxed. Raises InputError."""
    agent = agent.resolve()
    if not config.sandbox:
        return agent
    return box_agent(agent, list_hidden_folders(suite.folder, RUNS_FOLDER), run_folder)


def make_run_info(config: RunConfig, suite: Suite, labels: tuple[str, ...], declared_label: str) -> RunInfo:
    """Return the description of a run for its results. labels: those that no episode shows."""
    folder = config.find_folder(suite.name)
    info = {
        "agent": hide_locator(config.agent.name, folder),
        "labels": _mark_attacked(labels, config),
        "declared_label": declared_label,
        "agent_config": config.agent.config_hash(),
        "others": hide_locator(config.others.agent.name, folder) if config.others else "",
        "penetration": config.others.penetration if config.others else None,
        "suite": suite.name,
        "suite_checksum": suite.checksum(),
        "seed": config.seed,
        "seeds": config.seeds if config.has_many_seeds else (),
        "score_mode": config.score_mode,
        "versions": read_versions(config.agents),
        "plug_ins": identify_run_plug_ins(config),
        "command": hide_command(config.command, folder),
        **config.options.to_dict(),
        "comm": describe_comm(config.options.comm),
    }
    return RunInfo.model_validate(info)


def _mark_attacked(labels: Sequence[str], config: RunConfig) -> tuple[str, ...]:
    """Return the labels of a run, with `ATTACKED` if it is, which a variant of an honest run may be."""
    is_attacked = config.options.parsed_attack is not None
    return (*(label for label in labels if label != ATTACKED), *((ATTACKED,) if is_attacked else ()))


def check_agent_name(agent: AgentSpec) -> None:
    """Raise InputError for a name that is neither a built-in agent nor a locator, and for people."""
    name = agent.name
    if name == HUMAN:
        raise InputError(
            f"agent {HUMAN!r}: expected an agent that drives by itself, found a person, who drives with `mdrive-sumo"
            " drive`; the agent 'human-replay' repeats such a drive"
        )
    family = name.partition(":")[0]
    is_family = any(builtin.startswith(f"{family}:") for builtin in AGENTS)  # perception-swap:WHAT is no module
    check_plug_in_names(PlugInKind.AGENTS, AGENTS)
    if not isinstance(agent.agent, str) or agent.is_builtin or agent.plug_in is not None:
        return
    if clean_line(name) != name:
        raise InputError(f"agent {name!a:.80}: expected a name of printable characters, found others")
    if name.endswith(".py") and ":" not in name:
        raise InputError(f"agent {name!r}: expected path.py:Class, {describe_missing_class(Path(name))}")
    if ":" not in name or is_family:
        plug_ins = list_plug_ins(PlugInKind.AGENTS)
        suggestion = suggest_name(name, [*AGENTS, *plug_ins])
        expected = f"{', '.join((*AGENTS, *plug_ins))}, module:Class or path.py:Class"
        raise InputError(f"agent {name!r}: expected {expected}, found neither{suggestion}")


def declare_all_labels(agents: Sequence[AgentSpec], *, is_sandboxed: bool) -> tuple[str, tuple[str, ...]]:
    """Return the label that the agent under test declares, and the labels that follow from all agents of a run.

    agents: the one under test first. Raises InputError for agents that cannot be created, or cannot drive together.
    """
    if sum(is_joint_locator(agent.agent) for agent in agents) > 1:
        raise InputError("--others: expected at most one joint agent (carla:...) in a run, found two")
    declared = [declare_labels(agent, is_sandboxed=is_sandboxed) for agent in agents]
    return declared[0][0], tuple(dict.fromkeys(label for _, labels in declared for label in labels))


def declare_labels(agent: AgentSpec, *, is_sandboxed: bool) -> tuple[str, tuple[str, ...]]:
    """Create an agent; return the label that it declares, and the labels that follow from it. Raises InputError."""
    name = agent.name
    try:
        declaration = declare_agent(agent)
    except AgentFailure as error:
        raise InputError(f"agent {name!r}: cannot be created: {error.text.removeprefix('InputError: ')}") from None
    if unknown := find_unknown_sensor(declaration.sensors):
        raise InputError(unknown)
    facts = {
        JOINT: is_joint_locator(agent.agent),
        PRIVILEGED: any(sensor.kind == PRIVILEGED for sensor in declaration.sensors),
        UNSANDBOXED: not agent.is_builtin and not is_sandboxed,
    }
    return declaration.label, tuple(label for label, holds in facts.items() if holds)


def check_attack(config: RunConfig, scenarios: Sequence[Scenario]) -> None:
    """Raise InputError for an attack by stations that no scenario has, and for one without a channel."""
    attack = config.options.parsed_attack
    if attack is None:
        return
    if not config.options.comm.on:
        raise InputError(f"--attack {attack.text}: expected a channel over which stations can lie, found --comm off")
    cavs = [ego.id for scenario in scenarios for ego in scenario.egos]
    rsus = [rsu.id for scenario in scenarios for rsu in scenario.rsus]
    check_attackers(attack, cavs, rsus)


def check_mute(config: RunConfig, scenarios: Sequence[Scenario]) -> None:
    """Raise InputError if `--comm-mute` names a sender or type that the run cannot have, naming those that it can.

    A third-party agent may send types of its own, so for it every type can exist.
    """
    senders = {station.id for scenario in scenarios for station in (*scenario.egos, *scenario.rsus)}
    for pattern in config.options.comm.mute:
        sender, _, rest = pattern.partition("/")
        kind = rest.partition("@")[0]
        if sender not in {"*", *senders}:
            raise InputError(
                f"--comm-mute {pattern}: expected a sender among {', '.join(sorted(senders))} or *, found {sender!r}"
                f"{suggest_name(sender, senders)}"
            )
        if config.is_builtin and kind not in {"*", *TYPES}:
            suggestion = suggest_name(kind, TYPES)
            raise InputError(
                f"--comm-mute {pattern}: expected a type among {', '.join(TYPES)} or *, found {kind!r}{suggestion}"
            )
