"""Worker time: a simulated week of attacks through the real queue, and the budget of a submission."""

import heapq
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean

import pytest
from testing import databases
from testing.store_samples import GOOD, LEASE, NOON, PHASE, S, sent, states, summary, with_teams

from server.enums import JobState, SubmissionState
from server.store import Store, job_selection, jobs, phases, submissions, worker_time
from server.store.job_selection import WaitingSubmission
from server.store.quota import count_used
from server.store.tables import JobOverviewRow

MINUTE, HOUR = 60 * S, 3600 * S
WEEK = 7 * 24 * HOUR
WIDE = replace(PHASE, per_day=10_000, in_parallel=10_000, in_total=10_000)
HIDDEN = replace(WIDE, id="test", public=False)


@pytest.fixture(params=databases.BACKENDS)
def store(request: pytest.FixtureRequest) -> Store:
    return databases.emptied(request.param)


@dataclass(order=True)
class Arrival:
    """A submission that a team sends: so many jobs that each take `job_us`."""

    at_us: int
    team: str
    phase: str = field(compare=False)
    jobs: int = field(compare=False)
    job_us: int = field(compare=False)


def simulate(
    store: Store, arrivals: Sequence[Arrival], workers: int, end_us: int
) -> tuple[dict[str, list[int]], Counter[str]]:
    """Drive the real queue with a simulated clock: waiting times [us] and worker time [us] by team."""
    coming, free = sorted(arrivals, reverse=True), [(NOON, n) for n in range(workers)]
    job_us: dict[str, tuple[str, int, int]] = {}
    waited: dict[str, list[int]] = defaultdict(list)
    used: Counter[str] = Counter()
    running: list[tuple[int, int, int, str]] = []
    while free or running:
        while running and (not free or running[0][0] <= free[0][0]):
            now_us, worker, job_id, submission = heapq.heappop(running)
            with store.write() as session:
                assert jobs.finish(session, job_id, f"w{worker}", 1, GOOD, now_us)
                if submissions.finish_if_complete(session, submission, summary(1), now_us):
                    team, _, sent_us = job_us[submission]
                    waited[team].append(now_us - sent_us)
            heapq.heappush(free, (now_us, worker))
        now_us, worker = heapq.heappop(free)
        if now_us >= end_us:
            continue
        while coming and coming[-1].at_us <= now_us:
            one = coming.pop()
            with store.write() as session:
                wanted = [(f"s{n:03}", 0) for n in range(one.jobs)]
                row = sent(session, one.team, one.at_us, phase=one.phase, jobs=wanted)
                job_us[row.id] = (one.team, one.job_us, one.at_us)
        with store.write() as session:
            job = jobs.claim(session, f"w{worker}", 100 * HOUR, now_us)
        if job is not None:
            team, length_us, _ = job_us[job.submission]
            used[team] += length_us
            heapq.heappush(running, (now_us + length_us, worker, job.id, job.submission))
        elif coming:
            heapq.heappush(free, (max(coming[-1].at_us, now_us + MINUTE), worker))
        elif running:
            heapq.heappush(free, (running[0][0], worker))
    return waited, used


def honest(teams: Sequence[str]) -> list[Arrival]:
    """A submission of three worker hours a day of each team, eight hours apart, in the public phase."""
    return [
        Arrival(NOON + (24 * day + 8 * n + 1) * HOUR + n, team, "dev", 3, HOUR)
        for day in range(7)
        for n, team in enumerate(teams)
    ]


@pytest.mark.slow
def test_a_week_of_attacks_at_most_doubles_the_waiting_time() -> None:
    """Two teams flood the hidden phase and one the public phase with jobs of two hours; hidden came first always.

    On the first day all teams are new, and an honest one only gets its equal share.
    """

    def week(attacked: bool) -> tuple[list[list[int]], list[int]]:
        store = databases.emptied("sqlite")
        good, bad = with_teams(store, "a", "b", phase=WIDE), with_teams(store, "x", "y", "z", phase=HIDDEN)
        floods = [
            Arrival(NOON + n, team, phase, 90, 2 * HOUR)
            for n, (team, phase) in enumerate(zip(bad, ("test", "test", "dev"), strict=True))
        ]
        waited, used = simulate(store, honest(good) + (floods if attacked else []), 1, NOON + WEEK)
        return [waited[team] for team in good], [used[team] for team in bad]

    quiet_us = fmean(us for times in week(attacked=False)[0] for us in times)
    assert quiet_us == pytest.approx(3 * HOUR, rel=0.01)
    waited, shares = week(attacked=True)
    assert [len(times) for times in waited] == [7, 7]
    assert fmean(us for times in waited for us in times) <= 2 * quiet_us
    assert max(us for times in waited for us in times[1:]) <= 2 * quiet_us
    # What is left over is shared equally, whatever the phase.
    assert max(shares) - min(shares) <= 6 * HOUR and min(shares) > 30 * HOUR


def test_priority_only_decides_between_equals() -> None:
    hidden = WaitingSubmission("h", "red", "test", False, 2)
    public = WaitingSubmission("p", "blue", "dev", True, 1)
    step = job_selection.STEP_US
    choose = job_selection.choose
    assert choose([public, hidden], {}, Counter()) == "h"
    assert choose([public, hidden], {("red", "test"): step - 1}, Counter()) == "h"
    assert choose([public, hidden], {("red", "test"): step}, Counter()) == "p"
    assert choose([public, hidden], {("red", "other"): step}, Counter()) == "p"  # a team's time counts in all phases
    assert choose([public, hidden], {}, Counter({"red": 1})) == "p"
    mine = WaitingSubmission("q", "red", "dev", True, 3)
    assert choose([hidden, mine], {("red", "test"): step}, Counter()) == "q"


def test_a_host_may_serve_one_kind_of_phase(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=WIDE)
    with store.write() as session:
        phases.set_phases(session, [HIDDEN], NOON)
        public, hidden = sent(session, red, NOON).id, sent(session, red, NOON + 1, phase="test").id
    for kind, expected in ((True, public), (False, hidden)):
        with store.write() as session:
            job = jobs.claim(session, "w", LEASE, NOON, kind)
            assert job is not None and job.submission == expected


def test_worker_time_is_halved_with_age_and_survives_a_jumping_clock() -> None:
    assert worker_time.decay(1000, 0) == 1000 == worker_time.decay(1000, -HOUR)
    assert worker_time.decay(1000, worker_time.HALF_LIFE_US) == 500
    assert worker_time.decay(1000, 100 * worker_time.HALF_LIFE_US) == 0


def test_all_worker_time_is_charged_also_of_what_is_cancelled_or_fails(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=WIDE)
    with store.write() as session:
        submission = sent(session, red, jobs=[("a", 0), ("b", 0), ("c", 0)]).id
        first, second, _ = (jobs.claim(session, "w", LEASE, NOON) for _ in range(3))
        assert first is not None and second is not None
        assert jobs.finish(session, first.id, "w", 1, GOOD, NOON + 10 * S)
        assert jobs.record_failure(session, second.id, "w", 1, "SUMO crashed", NOON + 20 * S)
        assert submissions.get(session, submission).spent_us == 10 * S  # our failure uses no budget
        submissions.cancel(session, submission, NOON + 30 * S)  # the third runs
        recent = worker_time.load_recent(session, NOON + 30 * S)
    assert recent[red, "dev"] == pytest.approx(60 * S, rel=0.01)


def test_a_submission_over_its_budget_ends_with_a_clear_sentence(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=WIDE)
    with store.write() as session:
        submission = sent(session, red, jobs=[("a", 0), ("b", 0), ("c", 0)]).id
        job, running = (jobs.claim(session, "w", LEASE, NOON) for _ in range(2))
        assert job is not None and running is not None
        assert jobs.finish(session, job.id, "w", 1, GOOD, NOON + 30 * MINUTE)
        assert jobs.heartbeat(session, running.id, "w", 1, LEASE, NOON + 30 * MINUTE)
        budget_us = 10 * MINUTE  # of each job; every submission has an hour
        assert not submissions.end_if_over_budget(session, submission, budget_us, NOON + 30 * MINUTE)
        assert submissions.end_if_over_budget(session, submission, budget_us, NOON + 30 * MINUTE + S)
        assert not submissions.end_if_over_budget(session, submission, budget_us, NOON + 31 * MINUTE)
        found = submissions.get(session, submission)
        assert (found.state, found.counts, found.ds) == (SubmissionState.OVER_BUDGET, True, None)
        assert "more than the 1 hours of worker time" in found.why and "make the agent faster" in found.why
        assert states(session, submission) == [JobState.DONE, JobState.CANCELLED, JobState.CANCELLED]
        assert not jobs.heartbeat(session, running.id, "w", 1, LEASE, NOON + 31 * MINUTE)  # its boxes end
        assert count_used(session, red, "dev", NOON + HOUR).in_total == 1
        told = submissions.list_events(session, submission)[-1]
        assert told.data == {"state": "over-budget", "why": found.why}


def test_a_finished_submission_is_never_over_budget(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=WIDE)
    with store.write() as session:
        submission = sent(session, red, jobs=[("a", 0)]).id
        job = jobs.claim(session, "w", LEASE, NOON)
        assert job is not None and jobs.finish(session, job.id, "w", 1, GOOD, NOON + 5 * HOUR)
        assert submissions.finish_if_complete(session, submission, summary(1), NOON + 5 * HOUR)
        assert not submissions.end_if_over_budget(session, submission, S, NOON + 5 * HOUR)
        assert session.get(JobOverviewRow, job.id) is not None
