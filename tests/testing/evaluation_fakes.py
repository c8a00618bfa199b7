"""A challenge without a simulation: a suite of tiny scenarios, a stand-in for `run_submission_job`, a fast clock.

The description of a scenario is what driving it does. No tests in here. Run as a program it is a worker.
"""

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import EgoResult, ScenarioResult
from server import phase_suites
from server.clock import DAY_US, now_us
from server.enums import ChallengeTrack, ScenarioVerdict
from server.evaluation import worker
from server.evaluation.job_task import AgentRejection, JobResult, JobTask
from server.phase_suites import LoadedPhaseSuites
from server.settings import SandboxSettings, ServerSettings, WorkerSettings
from server.store import Store, jobs, phases, submissions, teams
from server.store.jobs import JobOutcome
from server.store.tables import SubmissionRow
from testing.suite_fakes import make_suite

FASTER = 20
"""Seconds of these workers' clocks in a second."""
LEASE_S, LONG_LEASE_S = 60, 1200
"""Three seconds of ours, where leases shall end; a minute, so that none does because a machine is slow."""


SHARED = SandboxSettings(backend="bubblewrap", hidden_on_shared_kernel=True, required=())
"""Boxes that start fast, whatever this machine has."""


def fast_clock() -> int:
    """The same in all processes."""
    return now_us() * FASTER


def steady() -> str:
    """In place of the code's checksum, so that a change of the code while a test runs does not end its workers."""
    return "of a test"


def settings(data: Path, processes: int = 2, lease_s: int = LONG_LEASE_S) -> ServerSettings:
    """Of a server in that folder."""
    work = WorkerSettings(processes=processes, spot_check=0.0, lease_s=lease_s, drop_caches=False)
    return ServerSettings(data=data, work=work, sandbox=SHARED)


def challenge(
    folder: Path, store: Store, *deeds: str, public: bool = True, lease_s: int = LONG_LEASE_S
) -> ServerSettings:
    """A migrated database with a team `t`, and a phase `p` whose scenarios do these deeds."""
    suite = make_suite(folder / "suite", *deeds)
    with store.write() as session:
        phase = phases.NewPhase("p", "A phase", str(suite.folder), public, 0, 10**6 * DAY_US, 50, 50, 500)
        phases.set_phases(session, [phase], 1)
        teams.create(session, "t", 1)
    return settings(folder, lease_s=lease_s)


def submitted(store: Store, options: ServerSettings, at_us: int, phase: str = "p", **changed: Any) -> str:
    """A new submission of the team `t`; returns its id."""
    loaded = LoadedPhaseSuites(options)
    with store.write() as session:
        row = phases.get(session, phase)
        new = submissions.NewSubmission(
            **{
                "team": teams.get(session, "t").id,
                "track": ChallengeTrack.SINGLE,
                "name": "method",
                "archive_sha256": f"{at_us:064x}",
                "archive_bytes": 1000,
                "environment": "python3.11-numpy",
                "evaluator": loaded.evaluator(row, "python3.11-numpy"),
            }
            | changed
        )
        return submissions.accept(session, new, row, loaded.jobs(row), at_us).id


def read(store: Store, submission: str) -> SubmissionRow:
    """As it stands."""
    with store.read() as session:
        return submissions.get(session, submission)


def fake(task: JobTask) -> JobResult:
    """Stands in for `run_submission_job`; notes that it was called."""
    with (task.data / "calls").open("a") as calls:
        calls.write(f"{task.submission} {task.scenario} {task.attempt}\n")
    scenario = next(one for one in load_suite(task.suite).scenarios if one.id == task.scenario)
    mark = task.data / f"{task.scenario}.tried"
    match scenario.description:
        case "reject":
            return AgentRejection("sensor 'x': expected one that there is, found none")
        case "raise":
            raise WorldError("SUMO lost the road")
        case "hang":
            mark.write_text(str(os.getpid()))
            time.sleep(600)
        case "hang once" if not mark.exists():
            mark.write_text(str(os.getpid()))
            time.sleep(600)
        case "die once" if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        case "nap":
            time.sleep(0.01)
        case _:
            pass
    if task.keeps_files:
        task.stage.mkdir(parents=True, exist_ok=True)
        (task.stage / f"{task.scenario}.npz").write_text(f"recorded in attempt {task.attempt}")
    failed = scenario.description == "agent fails"
    result = scored(task.scenario, scenario.bucket, failed)
    verdict = ScenarioVerdict.AGENT_FAILED if failed else ScenarioVerdict.OK
    return JobOutcome(
        verdict, result.model_dump(mode="json"), FailureReason.TIMEOUT if failed else None, {"wall_s": 1.0}
    )


def scored(scenario: str, bucket: str = "Tiny", failed: bool = False) -> ScenarioResult:
    """Always the same for a scenario."""
    ds = 0.0 if failed else 10.0 + int(scenario[1:]) % 90
    outcome = End.AGENT_FAILED if failed else End.ARRIVED
    reason = "timeout: act: no answer" if failed else ""
    ego = EgoResult(id="0", outcome=outcome, reason=reason, ds=ds, rc=ds, ip=1.0, infractions=())
    return ScenarioResult(
        id=scenario, bucket=bucket, category="deed", seed=0, status="ok", reason="", ds=ds, sr=0.0, rc=ds, ip=1.0,
        min_ttc=None, digest=f"{int(scenario[1:]):016x}", ticks=1, egos=(ego,),
    )  # fmt: skip


if __name__ == "__main__":
    from testing import evaluation_fakes  # so that the worker's own child finds `fake` by that name

    phase_suites.compute_code_checksum = steady
    jobs.MAX_FAILURES = 1000  # one job may be killed more often here than ever elsewhere
    sys.exit(worker.main(evaluation_fakes.fake, evaluation_fakes.fast_clock))
