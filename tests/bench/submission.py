"""How long one submission of the sample agent takes: `python tests/bench/submission.py [--every N] [--processes N]`.

All 225 packaged scenarios, or every Nth of them, in real boxes (a fresh one for each CAV and scenario), by the workers
of a supervisor. Prints wall and CPU time; CPU time says more where the machine is busy. The agents' part is that of the
boxes, of which about 0.12 s each is their start.
"""

import argparse
import os
import resource
import sys
import tempfile
import time
from hashlib import sha256
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1])]

from testing.archive_samples import packed  # noqa: E402
from testing.small_environment import describe_small_environment  # noqa: E402

from server import environments  # noqa: E402
from server.clock import DAY_US, now_us  # noqa: E402
from server.enums import ChallengeTrack  # noqa: E402
from server.evaluation.supervisor import Supervisor  # noqa: E402
from server.phase_suites import LoadedPhaseSuites  # noqa: E402
from server.settings import ServerSettings, WorkerSettings  # noqa: E402
from server.store import Store, phases, submissions, teams  # noqa: E402
from server.store.quota import UNFINISHED  # noqa: E402
from server.store.tables import JobRow  # noqa: E402

SAMPLE = Path(environments.__file__).parent / "samples" / "agent"
ENVIRONMENT = "python3.11-numpy"


def sample() -> dict[str, bytes]:
    """The files of the sample agent."""
    files = {str(path.relative_to(SAMPLE)): path.read_bytes() for path in SAMPLE.rglob("*") if path.is_file()}
    return {name: content for name, content in files.items() if "__pycache__" not in name}


def this_python(data: Path) -> None:
    """Says that this Python is the environment."""
    folder = data / "environments" / ENVIRONMENT
    folder.mkdir(parents=True)
    describe_small_environment(folder)


def stored_archive(data: Path) -> str:
    """Packs the sample; returns the archive's checksum."""
    archive = packed(sample())
    sha = sha256(archive).hexdigest()
    (data / "archives").mkdir(parents=True)
    (data / "archives" / f"{sha}.zip").write_bytes(archive)
    return sha


def queued(store: Store, settings: ServerSettings, sha: str, every: int) -> str:
    """The submission's id."""
    suites = LoadedPhaseSuites(settings)
    new_phase = phases.NewPhase("all", "All", "mdrive", True, 0, 10**6 * DAY_US, 50, 50, 500)
    with store.write() as session:
        phases.set_phases(session, [new_phase], now_us())
        teams.create(session, "team", now_us())
    with store.write() as session:
        phase = phases.get(session, "all")
        new = submissions.NewSubmission(
            team=teams.get(session, "team").id,
            track=ChallengeTrack.SINGLE,
            name="sample",
            archive_sha256=sha,
            archive_bytes=1000,
            environment=ENVIRONMENT,
            evaluator=suites.evaluator(phase, ENVIRONMENT),
        )
        return submissions.accept(session, new, phase, suites.jobs(phase)[::every], now_us()).id


def state(store: Store, submission: str) -> str:
    with store.read() as session:
        return submissions.get(session, submission).state


def measured(data: Path, every: int, processes: int) -> str:
    """One line of figures."""
    settings = ServerSettings(data=data, work=WorkerSettings(processes=processes, spot_check=0.0))
    store = Store(settings.database_url)
    store.migrate()
    this_python(data)
    submission = queued(store, settings, stored_archive(data), every)
    supervisor, since = Supervisor(store, settings), time.monotonic()
    supervisor.start()
    try:
        while state(store, submission) in UNFINISHED:
            time.sleep(0.2)
        wall_s = time.monotonic() - since
    finally:
        supervisor.stop()
    # Without the boxes: they end by a signal to bubblewrap, so no process of this tree waits for their own.
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    with store.read() as session:
        usages = [job.usage or {} for job in session.query(JobRow)]
    boxes = sum(len(one.get("boxes", {})) for one in usages)
    boxed_s = sum(one.get("cpu_s", 0.0) for one in usages)
    cpu_s = used.ru_utime + used.ru_stime
    return (
        f"{state(store, submission)}: {len(usages)} scenarios by {processes} workers: wall {wall_s:.0f} s, CPU"
        f" {cpu_s:.0f} s in evaluators and {boxed_s:.0f} s in {boxes} boxes"
        f" ({(cpu_s + boxed_s) / len(usages):.2f} s a scenario);"
        f" load average {os.getloadavg()[0]:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="mdrive-bench-") as folder:
        print(measured(Path(folder), options.every, options.processes))  # noqa: T201


if __name__ == "__main__":
    main()
