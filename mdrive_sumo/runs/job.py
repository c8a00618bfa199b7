"""One episode as a job for a worker process: everything is named, nothing is shared. The composition root of a run."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.agent_process.remote_driver import AgentLimits
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode import Ending, EpisodeRecord, ThinkTime, load_episode, save_episode
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import Hiring, RejectedError, hired
from mdrive_sumo.runs.transcript import save_transcript
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, score_episode
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.v2x.comm_settings import parse_comm


@dataclass(frozen=True)
class EpisodeJob:
    """Which episode to run, and how. Plain values, so that it can be sent to any process or machine."""

    suite_folder: str
    scenario: str
    agent: str
    agent_config: Mapping[str, Any]
    seed: int
    score_mode: str
    recording: str = ""
    """Path of the episode file to write; "" for none."""
    log_folder: str = ""
    """Where third-party agents' output goes; "" throws it away."""
    limits: AgentLimits = field(default_factory=AgentLimits)
    comm: str = "{}"
    """The V2X channel, as `v2x.settings.comm_text` writes it."""
    clock: str = "ideal"
    actors: str = "default"
    """How scripted road users behave, see `actors.ActorMode`."""
    friction: str = "dry"
    """How slippery roads are, see `scenario.weather.FrictionMode`."""
    transcripts: str = ""
    """Folder for the transcripts of language models; "" for none."""
    replayed: tuple[Ending, ...] = ()
    """Agent failures of the recorded run, for re-execution."""
    thought: tuple[ThinkTime, ...] = ()
    """How long agents thought in the recorded run, for re-execution."""
    box: str = ""
    """Where third-party agents live, as `drivers.box_text` writes it; "" is a plain child process."""


def run_job(job: EpisodeJob) -> ScenarioResult:
    """Drives, scores and (if asked to) records one scenario.

    Raises WorldError, InputError or OSError; RejectedError for an agent in a box that asks for what it cannot have.
    """
    scenario, roads = load_job_scenario(job)
    episode = _driven(job, scenario, roads)
    if job.recording:
        save_episode(episode, Path(job.recording))
    if job.transcripts:
        save_transcript(episode, Path(job.transcripts))
    return score_episode(episode, scenario, roads, ScoreMode(job.score_mode), job.seed)


def reexecute(job: EpisodeJob) -> EpisodeRecord:
    """Drives one scenario again, for comparison with its recording."""
    return _driven(job, *load_job_scenario(job))


def rescore(job: EpisodeJob) -> ScenarioResult:
    """Scores the recording of a job without simulating. Raises InputError."""
    scenario, roads = load_job_scenario(job)
    return score_episode(load_episode(Path(job.recording)), scenario, roads, ScoreMode(job.score_mode), job.seed)


def load_job_scenario(job: EpisodeJob) -> tuple[Scenario, RoadMap]:
    """The scenario of a job and its network. Raises InputError."""
    suite = _suite(job.suite_folder)
    scenario = next((s for s in suite.scenarios if s.id == job.scenario), None)
    if scenario is None:
        raise InputError(f"suite {suite.name}: expected a scenario {job.scenario!r}, found none")
    return scenario, load_road_map(find_network_folder(scenario.network, suite.home(scenario.id)))


@lru_cache(maxsize=2)
def _suite(folder: str) -> Suite:
    return load_suite(folder)


def _driven(job: EpisodeJob, scenario: Scenario, roads: RoadMap) -> EpisodeRecord:
    about = {
        "agent": job.agent, "seed": job.seed, "comm": job.comm, "agent_clock": job.clock, "actors": job.actors,
        "friction": job.friction,
    }  # fmt: skip
    friction = FrictionMode(job.friction)
    setting = EpisodeConfig(
        scenario,
        roads,
        job.seed,
        about,
        replayed_failures=job.replayed,
        comm=parse_comm(json.loads(job.comm)),
        clock=parse_clock(job.clock),
        actor_mode=ActorMode(job.actors),
        friction=friction,
        think_times=job.thought,
    )
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}
    sumo_seed, grip = derive_seed(job.seed, scenario.id, "sumo"), friction.grip(scenario.weather)
    logs = str(Path(job.log_folder) / scenario.id) if job.log_folder else ""
    hiring = Hiring(job.agent, job.agent_config, job.limits, job.box, logs)
    with hired(hiring, list(sizes)) as drivers, SumoWorld(scenario, roads, sizes, sumo_seed, grip) as world:
        try:
            return run_episode(setting, world, drivers)
        except InputError as error:  # the scenario has been checked before: it is about what an agent declared
            if job.box:
                raise RejectedError(str(error)) from None
            raise
