"""Cross-play on the server: who is driven among whom, when, and whose failure is whose."""

from collections.abc import Callable
from pathlib import Path

import pytest
from testing import databases
from testing.evaluation_bench import Bench, Inline, S
from testing.evaluation_fakes import scored, submitted

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.state import End
from mdrive_sumo.scoring import EgoResult
from server.api.cross_play_board import CrossPlayOut, read_cross_play
from server.api.problems import HiddenScenariosError
from server.api.submission_views import Caller
from server.enums import JobKind, JobState, ScenarioVerdict, TokenScope
from server.evaluation.cross_play import JUDGED_EPISODES
from server.evaluation.job_task import AgentRejection, JobResult, JobTask
from server.evaluation.worker import _compute_limit_s
from server.phase_suites import LoadedPhaseSuites
from server.store import audit, phases, submissions, teams
from server.store.jobs import JobOutcome
from server.store.row_check import find_row_differences
from server.store.tables import AuditEntryRow, JobRow, WorkerTimeRow

DEEDS = ("", "")
Pair = tuple[str, str]


def ego(name: str, ds: float, failed: bool = False, is_other: bool = False) -> EgoResult:
    outcome, reason = (End.AGENT_FAILED, "crashed: exit") if failed else (End.ARRIVED, "")
    return EgoResult(
        id=name, outcome=outcome, reason=reason, ds=ds, rc=ds, ip=1.0, infractions=(), is_other=is_other
    )  # fmt: skip


class Shared:
    """A phase in which teams drive together: each agent by the last digit of its archive."""

    def __init__(self, folder: Path, public: bool = True) -> None:
        self.bench = Bench(folder, databases.emptied("sqlite"))
        self.driven: list[tuple[Pair, str]] = []
        self.crashing, self.rejected, self.breaking = "", "", False
        self.bench.executor.function = self.drive
        self.bench.executor.slots = 3
        self.ids = [self.bench.begin(*(DEEDS if public else 5 * ("",)), public=public, archive_sha256="a" * 64)]
        for number, letter in enumerate("bc", 2):
            with self.bench.store.write() as session:
                team = teams.create(session, letter, number)
            self.ids.append(self.submit(team.id, letter))

    def submit(self, team: str, letter: str) -> str:
        bench = self.bench
        return submitted(bench.store, bench.settings, bench.now_us + 1, team=team, archive_sha256=letter * 64)

    def switch_on(self, scenarios: int = 2) -> None:
        with self.bench.store.write() as session:
            phases.get(session, "p").cross_play_scenarios = scenarios

    def drive(self, task: JobTask) -> JobResult:
        result = scored(task.scenario)
        if task.other is None:
            both = (ego("0", result.ds), ego("1", result.ds))
            return JobOutcome(ScenarioVerdict.OK, replace_egos(task.scenario, *both))
        pair = task.archive_sha256[0], task.other.archive_sha256[0]
        self.driven.append((pair, task.scenario))
        if self.breaking:
            raise WorldError("SUMO lost the road")
        if self.rejected in pair and self.rejected:
            return AgentRejection("sensor 'rgb': found another name of a camera")
        tested_fails, others_fail = (self.crashing == one for one in pair)
        egos = ego("0", 30.0 if tested_fails else 90.0, tested_fails), ego("1", 100.0, others_fail, is_other=True)
        return JobOutcome(ScenarioVerdict.OK, replace_egos(task.scenario, *egos))

    def jobs(self) -> list[JobRow]:
        with self.bench.store.read() as session:
            return list(session.query(JobRow).filter_by(kind=JobKind.CROSS_PLAY).order_by(JobRow.id))

    def run(self, steps: int = 15) -> None:
        self.bench.steps(steps, pause_us=20 * S)

    def board(self, admin: bool = False) -> CrossPlayOut:
        return read_cross_play(self.bench.store, Caller("admin", None, TokenScope.ADMIN) if admin else None, "p")


def replace_egos(scenario: str, *egos: EgoResult) -> dict[str, object]:
    return scored(scenario).model_copy(update={"egos": egos}).model_dump(mode="json")


def test_every_pair_of_teams_is_driven_both_ways_after_everything_else(tmp_path: Path) -> None:
    shared = Shared(tmp_path)
    shared.switch_on()
    shared.run(1)
    assert shared.driven == [] and shared.jobs() == []  # submissions wait
    shared.run()
    pairs = [pair for pair, _ in shared.driven]
    assert len(pairs) == 12 and {*pairs} == {(a, b) for a in "abc" for b in "abc" if a != b}
    assert {*pairs[:6]} == {*pairs}  # all pairs take turns
    assert len({scenario for _, scenario in shared.driven}) == 2
    board = shared.board()
    assert (board.jobs, board.unfinished) == (12, 0)
    assert [(agent.ds, agent.sr, agent.partners) for agent in board.agents] == [(90.0, 0.0, 2)] * 3
    assert [[cell.is_own_team for cell in agent.cells] for agent in board.agents] == [
        [True, False, False], [False, True, False], [False, False, True],
    ]  # fmt: skip
    with shared.bench.store.read() as session:
        used = {row.team: row.used_us for row in session.query(WorkerTimeRow)}
        assert len(used) == 3 and audit.verify_chain(session).broken is None
    shared.run(3)
    assert len(shared.driven) == 12  # nothing is driven twice
    with shared.bench.store.read() as session:
        assert {row.team: row.used_us for row in session.query(WorkerTimeRow)} == used  # it costs no team's time


def test_a_crash_counts_for_the_team_whose_agent_crashed(tmp_path: Path) -> None:
    shared = Shared(tmp_path)
    shared.switch_on(1)
    shared.crashing = "b"
    shared.run()
    board = {agent.submission: agent for agent in shared.board().agents}
    a, b, c = (board[name] for name in shared.ids)
    assert (b.ds, b.failed, b.partners) == (30.0, 2, 2)
    assert [(one.ds, one.failed, one.partners) for one in (a, c)] == [(90.0, 0, 1)] * 2  # of b's crash nothing counts
    of_b = next(cell for cell in a.cells if cell.others == shared.ids[1])
    assert (of_b.ds, of_b.episodes, of_b.left_out) == (None, 0, 1)


def test_a_phase_without_the_option_has_no_jobs_and_no_board(tmp_path: Path) -> None:
    shared = Shared(tmp_path)
    shared.run()
    assert shared.jobs() == []
    with pytest.raises(Exception, match="expected one with cross-play"):
        shared.board()


def test_of_a_hidden_phase_only_admins_see_the_board(tmp_path: Path) -> None:
    shared = Shared(tmp_path, public=False)
    with shared.bench.store.read() as session:
        many = len(phases.list_phases(session))
    assert many == 1
    shared.switch_on(1)
    with pytest.raises(HiddenScenariosError):
        shared.board()
    assert shared.board(admin=True).phase == "p"


def test_withdrawn_submissions_are_driven_no_more(tmp_path: Path) -> None:
    shared = Shared(tmp_path)
    shared.switch_on(2)
    while not shared.driven:
        shared.run(1)
    with shared.bench.store.write() as session:
        submissions.set_shown(session, shared.ids[2], False, shared.bench.now_us)
    done = len(shared.driven)
    shared.run()
    assert all("c" not in pair for pair, _ in shared.driven[done:])
    assert {agent.submission for agent in shared.board().agents} == {*shared.ids[:2]}


Change = Callable[[Shared], None]


def break_down(shared: Shared) -> None:
    shared.breaking = True


def reject_b(shared: Shared) -> None:
    shared.rejected = "b"


@pytest.mark.parametrize(("change", "calls"), [(break_down, 18), (reject_b, 6)], ids=("ours", "rejected"))
def test_what_has_no_score_is_nobodys_fault(change: Change, calls: int, tmp_path: Path) -> None:
    """Our failures are tried three times; a rejection once. Neither gives a score."""
    shared = Shared(tmp_path)
    shared.switch_on(1)
    change(shared)
    shared.run(40)
    assert len(shared.driven) == calls
    found = {agent.submission: agent.partners for agent in shared.board().agents}
    assert [found[name] for name in shared.ids] == ([0, 0, 0] if calls == 18 else [1, 0, 1])


def test_a_worker_that_stops_returns_its_job(tmp_path: Path) -> None:
    shared = Shared(tmp_path)
    shared.switch_on(1)
    while len(shared.jobs()) < 6:
        shared.run(1)
    bench = shared.bench
    bench.executor.slots = 1
    bench.executor.stuck = {job.scenario for job in shared.jobs()}
    bench.steps(3)
    held = next(job for job in shared.jobs() if job.state == JobState.RUNNING)
    bench.dispatcher._release_all()
    assert [job.state for job in shared.jobs() if job.id == held.id] == [JobState.QUEUED]
    bench.executor.stuck = set()
    shared.run()
    assert {job.state for job in shared.jobs()} == {JobState.DONE}
    assert max(job.failures for job in shared.jobs()) == 0


def test_a_pair_whose_worker_dies_is_scored_once_by_another(tmp_path: Path) -> None:
    shared = Shared(tmp_path)
    shared.switch_on(1)
    while len(shared.jobs()) < 6:
        shared.run(1)
    bench = shared.bench
    bench.executor.slots, bench.executor.stuck = 1, {job.scenario for job in shared.jobs()}
    bench.steps(2)
    [late] = bench.executor.waiting.items()
    bench.now_us += 61 * S
    executor = Inline(shared.drive)
    other = bench.another("two", executor)
    for _ in range(15):
        other.step(0.0, bench.stop)
        bench.now_us += 20 * S
    bench.executor.stuck = set()
    bench.dispatcher._write_results()
    bench.dispatcher._handle_outcome(late[0], shared.drive(late[1]))  # dropped: the lease had ended
    assert {job.state for job in shared.jobs()} == {JobState.DONE}
    assert sorted(job.attempt for job in shared.jobs()) == [1, 1, 1, 1, 1, 2]
    with bench.store.read() as session:
        entries = [entry for entry in session.query(AuditEntryRow) if entry.action == "cross-play-done"]
        assert len(entries) == 6
        assert {found.table for found in find_row_differences(session)} == {"phases"}  # switched on behind its back


def test_a_job_has_time_to_find_whose_fault_a_failure_was(tmp_path: Path) -> None:
    """Else an agent that takes its time could have every judgement of it ended as hung."""
    shared = Shared(tmp_path)
    store, settings = shared.bench.store, shared.bench.settings
    alone_s = _compute_limit_s(store, settings, LoadedPhaseSuites(settings), 0)
    shared.switch_on()
    assert _compute_limit_s(store, settings, LoadedPhaseSuites(settings), 0) == JUDGED_EPISODES * alone_s


def test_pairs_whose_suite_is_gone_are_cancelled_and_queued_again_once_it_is_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    shared = Shared(tmp_path)
    bench = shared.bench
    shared.run(4)
    shared.switch_on(1)
    bench.executor.slots = 0
    shared.run(1)
    assert [job.state for job in shared.jobs()] == [JobState.QUEUED] * 6
    bench.executor.slots = 3
    description, aside = tmp_path / "suite" / "suite.json", tmp_path / "aside"
    description.rename(aside)
    bench.dispatcher = bench.another("two")  # with nothing read yet
    shared.run(3)
    assert [job.state for job in shared.jobs()] == [JobState.CANCELLED] * 6
    said = [record.message for record in caplog.records if "no jobs of cross-play are added" in record.message]
    assert len(said) == 1 and "phase p" in said[0] and "suite.json" in said[0]
    aside.rename(description)
    shared.run(4)
    assert [job.state for job in shared.jobs()] == [JobState.DONE] * 6
    assert len(shared.driven) == 6 and (shared.board().jobs, shared.board().unfinished) == (6, 0)
