"""EpisodeJob: one episode as a typed, picklable value for a worker process. The composition root of a run."""

import logging
import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from mdrive_sumo.agent_process.agent_connection import ConnectionGroup
from mdrive_sumo.agent_process.sandbox import BoxKilledError
from mdrive_sumo.agents.registry import ASKING_AGENTS
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_locator
from mdrive_sumo.core.state import End
from mdrive_sumo.episode import Ending, EpisodeRecord, ThinkTimeEntry, drop_payloads, load_episode, save_episode
from mdrive_sumo.episode.camera_archive import CameraArchiveWriter
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import AgentDriver
from mdrive_sumo.loop.human_actions import ActionSource
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import RejectedError, open_agents
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.runs.take_actions import load_take_actions
from mdrive_sumo.runs.transcript import save_transcript, transcript_path
from mdrive_sumo.scenario.reference_times import find_reference_times
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite_of_one
from mdrive_sumo.scenario.variation import load_varied_scenario
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, score_episode
from mdrive_sumo.scoring.metrics import EpisodeMismatch
from mdrive_sumo.scoring.roles import mark_tested
from mdrive_sumo.v2x.messages import FEATURE

LOG = logging.getLogger("mdrive.episode")
ATTEMPTS = 2
"""Episodes that a job drives at most, see `_drive`: limits of its time count the agents' limits so often."""


@dataclass(frozen=True)
class EpisodeJob:
    """One episode to run. It can be sent to any process or machine that has the suite."""

    suite_folder: Path
    scenario: str
    agent: AgentSpec
    seed: int = 0
    score_mode: ScoreMode | None = None
    """None: that of the suite."""
    options: EpisodeOptions = field(default_factory=EpisodeOptions)
    recording: Path | None = None
    """The episode file to write; None: none."""
    record_features: bool = True
    """Whether it has the content of `feature` messages."""
    logs: Path | None = None
    """Folder for the output of third-party agents; None discards it."""
    transcripts: Path | None = None
    """Folder for the transcripts of language models; None: none."""
    cameras: Path | None = None
    """File for the camera images that agents are given; None: none."""
    replayed_failures: tuple[Ending, ...] = ()
    """Agent failures of the recorded run, for re-execution."""
    think_times: tuple[ThinkTimeEntry, ...] = ()
    """Think times of the agents of the recorded run, for re-execution."""
    checksum: str = ""
    """Of the scenario's file when the run was prepared, because a worker reads it again; "": not checked."""
    others: OtherAgents | None = None
    """The agents of the CAVs that are not under test; None: `agent` drives all."""
    actions: Mapping[str, ActionSource] = field(default_factory=dict[str, ActionSource])
    """What people do, by CAV, for the agent `human`."""


def run_job(job: EpisodeJob) -> ScenarioResult:
    """Drive and score one scenario, and write the files that the job names.

    Raises WorldError, InputError or OSError; RejectedError for a boxed agent that declares a sensor it must not have.
    """
    scenario, roads = load_job_scenario(job)
    episode = _drive(job, scenario, roads)
    if job.recording:
        save_episode(episode if job.record_features else drop_payloads(episode, (FEATURE,)), job.recording)
    if job.transcripts:
        save_transcript(episode, job.transcripts)
    return score_job_episode(job, episode)


def score_job_episode(job: EpisodeJob, episode: EpisodeRecord) -> ScenarioResult:
    """Return the score of an episode of a job's scenario, with the suite's reference times. Raises InputError."""
    scenario, roads = load_job_scenario(job)
    suite = _load_suite_of_job(job)
    reference = find_reference_times(scenario, suite.find_folder(scenario.id))
    mode = job.score_mode or ScoreMode(suite.score_mode)
    result = score_episode(episode, scenario, roads, mode, job.seed, reference)
    if job.others is None:
        return result
    return mark_tested(result, job.others.choose_tested(scenario, job.seed))


def reexecute(job: EpisodeJob) -> EpisodeRecord:
    """Drive one scenario again, for comparison with its recording."""
    return _drive(job, *load_job_scenario(job))


def make_reexecution(job: EpisodeJob, recorded: EpisodeRecord) -> EpisodeJob:
    """Return the job that repeats a recording: agent failures, think times and answers of language models are replayed.

    So are the actions of people. It writes no files. Raises InputError for a take with damaged notes.
    """
    actions = {ego: RecordedActions(recorded, ego) for ego in recorded.ego_ids} if job.agent.agent == HUMAN else {}
    return replace(
        make_silent_job(job),
        replayed_failures=tuple(ending for ending in recorded.endings if ending.end is End.AGENT_FAILED),
        think_times=recorded.thinking,
        actions=actions,
    )


def make_silent_job(job: EpisodeJob) -> EpisodeJob:
    """Return the job without output files, whose agents ask no language model but replay its answers."""
    transcript = transcript_path(job.transcripts, job.scenario) if job.transcripts else None
    agent = replay_language_model(job.agent, transcript)
    return replace(job, agent=agent, recording=None, logs=None, transcripts=None, cameras=None)


def replay_language_model(agent: AgentSpec, transcript: Path | None) -> AgentSpec:
    """Return the agent with the answers of a transcript, if there is one.

    A built-in agent never asks the endpoint that a stored run names: a stranger's run could name any, and any
    environment variable as its key. Nor does it need the weights of a model on board, or the file of
    `eval --transcript`, whose answers the run has copied. Without a transcript it has no answers, as one that asked
    nothing.
    """
    config = dict(agent.config)
    if transcript is not None and transcript.is_file():
        config["transcript"] = str(transcript)
    if agent.is_builtin:
        if config.pop("endpoint", ""):
            config.setdefault("talk", "endpoint")
            config.pop("api_key_env", None)
        if agent.agent in ASKING_AGENTS:
            config.setdefault("transcript", os.devnull)
        if "transcript" in config and not Path(str(config["transcript"])).is_file():
            config["transcript"] = os.devnull
    return replace(agent, config=config)


def rescore(job: EpisodeJob) -> ScenarioResult:
    """Score the recording of a job without simulation. Raises InputError."""
    assert job.recording is not None, "a job with a recording"
    try:
        return score_job_episode(job, load_episode(job.recording))
    except EpisodeMismatch as mismatch:  # it was changed: what was just recorded cannot contradict itself
        raise InputError(f"{job.recording}: {mismatch}") from None


def load_job_scenario(job: EpisodeJob) -> tuple[Scenario, RoadMap]:
    """Return the scenario of a job as its seed draws it, and its network. Raises InputError."""
    suite = _load_suite_of_job(job)
    return load_varied_scenario(suite, suite.scenarios[0], job.seed)


def _load_suite_of_job(job: EpisodeJob) -> Suite:
    """Return the suite with the scenario of the job only. Raises InputError, also for a file that was changed."""
    suite = _load_suite_once(job.suite_folder, job.scenario)
    if job.checksum and job.checksum != suite.compute_file_checksum(job.scenario):
        path = suite.find_scenario_file(job.scenario)
        raise InputError(f"{path}: expected the scenario with which the run began, found a changed one")
    return suite


@lru_cache(maxsize=2)
def _load_suite_once(folder: Path, scenario: str) -> Suite:
    return load_suite_of_one(Path(folder), scenario)


def _describe_agents(job: EpisodeJob) -> dict[str, str]:
    others = {"others": hide_locator(job.others.agent.name)} if job.others else {}
    return {"agent": hide_locator(job.agent.name), **others}


def _drive(job: EpisodeJob, scenario: Scenario, roads: RoadMap) -> EpisodeRecord:
    """Drive the episode; once more if a signal that may have come from outside ended the program of a box.

    Nothing tells who has sent such a signal. The second time it is the agent's failure, or an agent that kills itself
    would never get a result.
    """
    try:
        return _drive_once(job, scenario, roads)
    except BoxKilledError as error:
        LOG.warning("%s: %s; the episode is driven once more", scenario.id, error)
    others = replace(job.others, agent=job.others.agent.own_signals()) if job.others is not None else None
    return _drive_once(replace(job, agent=job.agent.own_signals(), others=others), scenario, roads)


def build_episode_config(job: EpisodeJob, scenario: Scenario, roads: RoadMap) -> EpisodeConfig:
    """Return the configuration of the episode of a job, of `load_job_scenario`."""
    return EpisodeConfig(
        scenario,
        roads,
        job.seed,
        {
            **_describe_agents(job),
            "seed": job.seed,
            **job.options.to_dict(),
        },
        replayed_failures=job.replayed_failures,
        options=job.options,
        think_times=job.think_times,
    )


def _drive_once(job: EpisodeJob, scenario: Scenario, roads: RoadMap) -> EpisodeRecord:
    config = build_episode_config(job, scenario, roads)
    logs = job.logs / scenario.id if job.logs is not None else None
    with (
        _open_drivers(job, scenario, config, logs) as drivers,
        open_world(config) as world,
        CameraArchiveWriter(job.cameras) if job.cameras else nullcontext() as cameras,
    ):
        try:
            return run_episode(config, world, drivers, cameras.add if cameras else None, job.agent.limits.pace_s)
        except InputError as error:  # the scenario has been checked before: it is about the agent's declaration
            if job.agent.box is not None:
                raise RejectedError(str(error)) from None
            raise


@contextmanager
def _open_drivers(
    job: EpisodeJob, scenario: Scenario, config: EpisodeConfig, logs: Path | None
) -> Generator[dict[str, AgentDriver]]:
    """Start the agents of an episode and yield driver by CAV id, in the order of the scenario."""
    known, group = config.cav_pseudonyms, ConnectionGroup()
    actions = job.actions or load_take_actions(job.agent, scenario)
    if job.others is None:
        with open_agents(job.agent, known, logs, group, actions) as drivers:
            yield drivers
        return
    tested = job.others.choose_tested(scenario, job.seed)
    rest = {ego: name for ego, name in known.items() if ego not in tested}
    others = job.others.agent.with_pace(job.agent.limits.pace_s)
    with (
        open_agents(job.agent, {ego: known[ego] for ego in known if ego in tested}, logs, group, actions) as first,
        open_agents(others, rest, logs, group, load_take_actions(others, scenario)) as second,
    ):
        yield {ego: (first | second)[ego] for ego in known}
