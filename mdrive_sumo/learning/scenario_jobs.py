"""One scenario as the job of a worker process, and the order of jobs that keeps all workers busy to the end."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.drive_episode import collect_scenario
from mdrive_sumo.learning.sample_files import pack_samples, write_members
from mdrive_sumo.learning.sample_format import CollectedScenario
from mdrive_sumo.scenario.scenario import Scenario

LAST_JOBS_A_WORKER = 4
"""So many jobs a worker are ordered by length, the others by index, so that shards are complete early.

Modelled with the estimates of 400 scenarios (`estimate_work`), which miss the true lengths by 20 %, 32 workers are busy
for 92, 97 and 100 % of the time with 128, 224 and 3000 scenarios, as if all were ordered by length; for 69, 79 and 98 %
if none were, and for 55, 66 and 96 % with four scenarios a job."""
OTHERS_AS_ONE_CAV = 60.0
"""Other road users that double the time of a CAV's tick: 24 made it 1.4 times with all rigs, 1.6 without images."""


class WaitingScenario(BaseModel):
    """A finished scenario that waits for the others of its shard, as the journal keeps it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scenario: CollectedScenario
    bytes: int
    checksum: str
    """SHA-256 of the file with its samples, "sha256:HEX"."""


@dataclass(frozen=True, slots=True)
class ScenarioJob:
    """One scenario to drive."""

    settings: CollectionSettings
    path: Path
    """File for its samples."""
    index: int


def run_scenario_job(job: ScenarioJob) -> WaitingScenario:
    """Drive a scenario and write its samples. Raises InputError and OSError."""
    scenario, samples = collect_scenario(job.settings, job.index)
    size, checksum = write_members(job.path, pack_samples(samples))
    return WaitingScenario(scenario=scenario, bytes=size, checksum=checksum)


def order_jobs(jobs: Sequence[ScenarioJob], workers: int) -> list[ScenarioJob]:
    """Return jobs in the order in which they start: as they are, but the last ones longest first. Raises InputError."""
    count = LAST_JOBS_A_WORKER * workers if workers > 1 else 0
    first = max(len(jobs) - count, 0)
    return [*jobs[:first], *sorted(jobs[first:], key=_estimate_job, reverse=True)]


def _estimate_job(job: ScenarioJob) -> float:
    chosen = job.settings.load_scenario(job.index)
    return 0.0 if chosen is None else estimate_work(chosen[0])


def estimate_work(scenario: Scenario) -> float:
    """Return how much time a scenario takes, in the time of a lone CAV for one metre of its route.

    A sample takes far longer than a tick of SUMO, and a CAV has five a second: by the protocol it drives 8 m/s, and
    needs 3.0 to 3.6 ticks a metre with its waiting. (`runs.episode_cost` fits runs, whose ticks are cheap: eight other
    road users count as a CAV.)
    """
    metres = sum(len(ego.route) - 1 for ego in scenario.egos)  # points are 1 m apart
    return metres * (1.0 + (len(scenario.background.vehicles) + len(scenario.actors)) / OTHERS_AS_ONE_CAV)
