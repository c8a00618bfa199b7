"""What `md.simulate` costs beside the job of a worker process: the same episode, interleaved in one process."""

import statistics
import time
from collections.abc import Callable, Iterator

import mdrive_sumo as md
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scoring import ScoreMode

SCENARIO, AGENT = "i11_ins_sl_town", "sharing"
ROUNDS = 7
Row = tuple[str, float, str, str]


def front_door_rows() -> Iterator[Row]:
    """Ratio of the medians of CPU time, both with scores and without a recording on disk."""
    job = EpisodeJob(str(find_suite_folder("interdrive@0")), SCENARIO, AgentSpec(AGENT), 0, ScoreMode.MDRIVE)
    ways: tuple[Callable[[], object], ...] = (lambda: run_job(job), lambda: md.simulate(SCENARIO, AGENT).result)
    seconds: tuple[list[float], ...] = ([], [])
    for way in ways:  # caches: networks, suites, imports
        way()
    for _ in range(ROUNDS):
        for way, found in zip(ways, seconds, strict=True):
            begin = time.process_time()
            way()
            found.append(time.process_time() - begin)
    worker, simulate = map(statistics.median, seconds)
    yield f"md.simulate against a worker's job, {SCENARIO}, {AGENT}", simulate / worker, "x", "<= 1.05"
    yield "  a worker's job, CPU time", worker, "s", ""


if __name__ == "__main__":
    for name, value, unit, target in front_door_rows():
        print(f"{name}: {value:.3f} {unit} {target}")  # noqa: T201
