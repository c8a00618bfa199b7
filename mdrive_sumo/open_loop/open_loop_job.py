"""OpenLoopJob: one recording and the agents that see it, as a picklable value for a worker process."""

from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import load_episode
from mdrive_sumo.loop import EpisodeConfig
from mdrive_sumo.open_loop.drive_open_loop import OpenLoopSamples, drive_open_loop
from mdrive_sumo.open_loop.results import OpenLoopScenario, compute_metrics
from mdrive_sumo.runs.episode_job import EpisodeJob, load_job_scenario
from mdrive_sumo.runs.open_agents import open_agents
from mdrive_sumo.scenario.scenario import Scenario


@dataclass(frozen=True)
class OpenLoopJob:
    """One recording to show to an agent."""

    episode_job: EpisodeJob
    """Scenario, seed and options of the recording, and the agent under test."""
    recording: Path


def run_open_loop_job(job: OpenLoopJob) -> OpenLoopScenario:
    """Return the metrics of an agent in one recording. Raises InputError."""
    scenario, roads = load_job_scenario(job.episode_job)
    episode = load_episode(job.recording)
    if episode.scenario != scenario.id or episode.ego_ids != tuple(ego.id for ego in scenario.egos):
        raise InputError(f"{job.recording}: expected a recording of {scenario.id}, found one of {episode.scenario!r}")
    drive = job.episode_job
    config = EpisodeConfig(scenario, roads, drive.seed, options=drive.options)
    logs = drive.logs / scenario.id if drive.logs is not None else None
    with open_agents(drive.agent, config.cav_pseudonyms, logs) as drivers:
        samples = drive_open_loop(config, episode, drivers)
    return build_result(scenario, drive.seed, samples, episode.digest)


def build_result(scenario: Scenario, seed: int, samples: OpenLoopSamples, digest: str) -> OpenLoopScenario:
    """Return the published form of what was scored in one recording."""
    counts = samples.detections
    rows = None
    if counts is not None:
        rows = tuple((score / 1000, *found) for score, found in sorted(counts.by_score.items(), reverse=True))
    return OpenLoopScenario(
        **compute_metrics(samples).model_dump(),
        id=scenario.id,
        bucket=scenario.bucket,
        category=scenario.category,
        seed=seed,
        skipped=dict(samples.skipped),
        failures=samples.failures,
        sensing_track=samples.sensing_track.value,
        digest=digest,
        precision_counts=rows,
    )
