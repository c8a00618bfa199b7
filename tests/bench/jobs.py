"""What worker processes cost: their start, the parent's own work, and how well the order of scenarios fills them.

python tests/bench/jobs.py [AGENT] [EVERY]     every EVERY-th of the 225 scenarios of `mdrive`, driven in this process

The busy share is that of list scheduling by the processor times that were measured: no start, no memory bus. The last
rows name the scenarios that alone take longer than a 64th of the suite.
"""

import heapq
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_cost import estimate_cost
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.executor import Key
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.process_pool import ProcessPool
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scoring import ScenarioResult

Row = tuple[str, float, str, str]
WORKERS = (2, 8, 16, 32, 64)
STARTED = 8


MISSING = EpisodeJob(Path("/nowhere"), "none", AgentSpec("constant-speed"))
"""Its outcome is a sentence, at once."""


def start_rows() -> Iterator[Row]:
    """Time from the first job to the first result, and to that of each further worker."""
    began = time.perf_counter()
    with ProcessPool[EpisodeJob, ScenarioResult](run_job, STARTED + 1, 60.0) as pool:
        pool.submit("first", MISSING)
        pool.collect_outcomes()
        first = time.perf_counter() - began
        began, answers = time.perf_counter(), 0
        pool._idle.clear()  # pyright: ignore[reportPrivateUsage] - each job gets a worker of its own
        for number in range(STARTED):
            pool.submit(str(number), MISSING)
        while answers < STARTED:
            answers += len(pool.collect_outcomes())
        yield "start of the first worker, with what it imports", first, "s", "<= 0.5"
        yield "start of each further worker", (time.perf_counter() - began) / STARTED, "s", "<= 0.02"


class Replay:
    """An executor whose jobs are finished at once: all that a run takes with it is the parent's own work."""

    free_slots = 1

    def __init__(self, results: dict[tuple[str, int], ScenarioResult]) -> None:
        self._results, self._done = results, list[tuple[Key, ScenarioResult]]()

    def submit(self, key: Key, job: EpisodeJob) -> None:
        self._done.append((key, self._results[job.scenario, job.seed]))

    def collect_outcomes(self, *_: object) -> list[tuple[Key, ScenarioResult]]:
        done, self._done = self._done, []
        return done

    def cancel(self, key: Key) -> None:
        """A job is finished as soon as it is submitted."""


class Silent:
    """Progress that nobody sees."""

    def begin(self, *_: object) -> None: ...
    def done(self, *_: object) -> None: ...
    def show_running(self, *_: object) -> None: ...
    def note(self, text: str) -> None:
        raise AssertionError(text)


def scheduling_rows(agent: str, every: int, folder: Path) -> Iterator[Row]:
    """Drive scenarios, and schedule them by what they took."""
    scenarios = ",".join(one.id for one in _prepare(agent, "*", folder).scenarios[::every])
    began = time.process_time()
    run = _prepare(agent, scenarios, folder)
    yield f"preparation of a run of {len(run.scenarios)} scenarios", time.process_time() - began, "s", "-"
    run.make_folders()
    results: dict[tuple[str, int], ScenarioResult] = {}
    cpu_s: dict[str, float] = {}
    for key, scenario in run.episodes.items():
        began = time.process_time()
        results[key] = run_job(run.make_job(scenario, key[1]))
        cpu_s[scenario.id] = time.process_time() - began
    began = time.process_time()
    evaluate(run, Silent(), Replay(results))
    yield "work of the parent for each episode", (time.process_time() - began) / len(results) * 1e3, "ms", "<= 2"
    yield f"all episodes of {agent}, on one core", sum(cpu_s.values()), "s", "-"
    yield "median episode", statistics.median(cpu_s.values()), "s", "-"
    ordered = sorted(run.scenarios, key=lambda one: estimate_cost(one, run.suite.find_folder(one.id)), reverse=True)
    times = [cpu_s[scenario.id] for scenario in ordered]
    for workers in WORKERS:
        share, best = (compute_busy_share(order, workers) for order in (times, sorted(times, reverse=True)))
        yield f"busy share of {workers} workers, and if all times were known", share, f"{best:.2f}", "-"
    share_s = sum(times) / WORKERS[-1]
    for name, took in sorted(cpu_s.items(), key=lambda item: -item[1]):
        if took > share_s:
            yield f"  longer than a {WORKERS[-1]}th: {name}", took, "s", f"<= {share_s:.2f}"


def compute_busy_share(times: Sequence[float], workers: int) -> float:
    """Return the share of the time in which workers are busy that take jobs of these times [s] in this order."""
    ends = [0.0] * workers
    for took in times:
        heapq.heappush(ends, heapq.heappop(ends) + took)
    return sum(times) / workers / max(ends)


def _prepare(agent: str, scenarios: str, folder: Path) -> PreparedRun:
    return prepare(RunConfig(suite="mdrive", agent=AgentSpec(agent), scenario=scenarios, out=folder / "run"))


def main(agent: str = "constant-speed", every: str = "1") -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as scratch:
        for rows in (start_rows(), scheduling_rows(agent, int(every), Path(scratch))):
            for row in rows:
                sys.stdout.write(f"{row[0]:<66}{row[1]:>10.3f} {row[2]:<8}{row[3]}\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
