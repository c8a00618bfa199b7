"""Hidden and public work on one host: never at the same time, and neither waits for ever."""

import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from testing.evaluation_fakes import settings
from testing.suite_fakes import make_suite

from mdrive_sumo.core.errors import InputError
from server.clock import DAY_US
from server.enums import ChallengeTrack
from server.evaluation import phase_separation
from server.evaluation.phase_separation import CLAIMED, TURN_US, PhaseSeparation, describe_mixed_phases
from server.phase_suites import LoadedPhaseSuites
from server.settings import ServerSettings, load_settings
from server.store import Store, jobs, phases, submissions, teams
from server.store.tables import JobRow

LEASE_US = 10**12


@pytest.fixture
def separation(tmp_path: Path) -> Iterator[Callable[..., PhaseSeparation]]:
    """Dispatchers of one server on this host."""
    made: list[PhaseSeparation] = []

    def make(kinds: Any = "all", folder: Path = tmp_path) -> PhaseSeparation:
        made.append(PhaseSeparation(kinds, folder, drop_caches=False))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def queue(tmp_path: Path) -> Iterator[Store]:
    """A hidden and a public phase with 12 jobs each."""
    store = Store(f"sqlite:///{tmp_path / 'a.sqlite'}")
    store.migrate()
    options = settings(tmp_path)
    suite = make_suite(tmp_path / "suite", *(["nap"] * 12))
    loaded = LoadedPhaseSuites(options)
    with store.write() as session:
        kinds = {"hidden": False, "public": True}
        rows = [phases.NewPhase(k, k, str(suite.folder), p, 0, 10**6 * DAY_US, 50, 50, 500) for k, p in kinds.items()]
        phases.set_phases(session, rows, 1)
        team = teams.create(session, "t", 1).id
        for i, name in enumerate(kinds):
            phase = phases.get(session, name)
            track, environment = ChallengeTrack.SINGLE, "python3.11-numpy"
            new = submissions.NewSubmission(
                team=team,
                track=track,
                name=name,
                archive_sha256=f"{i:064x}",
                archive_bytes=1,
                environment=environment,
                evaluator=loaded.evaluator(phase, environment),
            )
            submissions.accept(session, new, phase, loaded.jobs(phase), 1 + i)
    yield store
    store.close()


def claim(store: Store, dispatcher: PhaseSeparation, now_us: int) -> tuple[JobRow, bool] | None:
    with store.write() as session:
        job = dispatcher.claim(session, lambda public: jobs.claim(session, "me", LEASE_US, now_us, public), now_us)
        if job is None:
            return None
        public = phases.get(session, submissions.get(session, job.submission).phase).public
    dispatcher.rename(CLAIMED, str(job.id))
    return job, public


def test_one_host_runs_one_kind(separation: Callable[..., PhaseSeparation]) -> None:
    one, two = separation(), separation()
    assert one.try_begin("a", True, 0)
    assert two.try_begin("b", True, 0)
    assert not two.try_begin("c", False, 0)
    one.end("a")
    assert not one.try_begin("c", False, 0)
    two.end("b")
    assert one.try_begin("c", False, 0)
    assert not two.try_begin("d", True, 0)


def test_another_server_and_a_dead_dispatcher_do_not_count(
    separation: Callable[..., PhaseSeparation], tmp_path: Path
) -> None:
    one, two, other = separation(), separation(), separation(folder=tmp_path / "other")
    assert one.try_begin("a", True, 0)
    assert other.try_begin("a", False, 0)
    one.close()  # as the kernel does when its process ends
    assert two.try_begin("b", False, 0)


def test_a_job_that_may_not_run_now_stays_as_it_was(separation: Callable[..., PhaseSeparation], queue: Store) -> None:
    one, two = separation(), separation()
    assert two.try_begin("a check", True, 0)
    found = claim(queue, one, 0)
    assert found is not None and found[1]  # hidden jobs come first, but a public one may run
    assert claim(queue, one, 2 * TURN_US) is None
    with queue.read() as session:
        rows = session.query(JobRow).all()
    assert [(row.id, row.attempt) for row in rows if row.attempt] == [(found[0].id, 1)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_all_jobs_are_run_by_turns_and_no_two_kinds_together(
    separation: Callable[..., PhaseSeparation], queue: Store, seed: int
) -> None:
    """Three dispatchers that claim and finish in random order: a model of a host."""
    draw = random.Random(seed)
    dispatchers = [separation() for _ in range(3)]
    running: list[dict[int, tuple[JobRow, bool]]] = [{} for _ in dispatchers]
    done, now_us = 0, 0
    for _ in range(2000):
        now_us += draw.randrange(60_000_000)
        i = draw.randrange(3)
        if running[i]:
            job, _ = running[i].pop(next(iter(running[i])))
            with queue.write() as session:
                jobs.release(session, job.id, "me", job.attempt)
                session.get_one(JobRow, job.id).state = "done"
            dispatchers[i].end(str(job.id))
            done += 1
        elif (found := claim(queue, dispatchers[i], now_us)) is not None:
            running[i][found[0].id] = found
        assert len({public for held in running for _, public in held.values()}) <= 1
        if done == 24:
            return
    pytest.fail(f"only {done} of 24 jobs were run")


@pytest.mark.slow
def test_workers_of_one_kind_take_no_other(separation: Callable[..., PhaseSeparation], queue: Store) -> None:
    found = [claim(queue, separation("public"), 0), claim(queue, separation("public"), 2 * TURN_US)]
    assert [each is not None and each[1] for each in found] == [True, True]
    assert claim(queue, separation("hidden"), 0) is None


def test_the_page_cache_is_dropped_between_the_kinds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drop").write_text("")
    monkeypatch.setattr(phase_separation, "CACHES", tmp_path / "drop")
    found = PhaseSeparation("all", tmp_path, drop_caches=True)
    for key, public, content in (("a", True, ""), ("b", True, ""), ("c", False, "1\n")):
        assert found.try_begin(key, public, 0)
        found.end(key)
        assert (tmp_path / "drop").read_text() == content


def test_inode_numbers_are_moved_between_the_kinds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On each processor, and the thread may run on all of them again afterwards."""
    monkeypatch.setattr(phase_separation, "CACHES", tmp_path / "drop")
    draws: list[int] = []
    monkeypatch.setattr(phase_separation.secrets, "randbelow", lambda most: draws.append(most) or most - 1)
    processors = os.sched_getaffinity(0)
    found = PhaseSeparation("all", tmp_path, drop_caches=True)
    for key, public, moved in (("a", True, False), ("b", False, True), ("c", False, False)):
        before = look_at_numbers(processors)
        assert found.try_begin(key, public, 0)
        found.end(key)
        assert os.sched_getaffinity(0) == processors
        now = look_at_numbers(processors)
        assert not moved or all(b - a >= phase_separation.MOST_MOVED - 1 for a, b in zip(before, now, strict=True))
        assert draws == [phase_separation.MOST_MOVED] * (len(processors) if moved else 0)
        draws.clear()


def look_at_numbers(processors: set[int]) -> list[int]:
    """Of a new pipe on each processor."""
    found: list[int] = []
    for processor in sorted(processors):
        os.sched_setaffinity(0, {processor})
        ends = os.pipe()
        found.append(os.fstat(ends[0]).st_ino)
        for end in ends:
            os.close(end)
    os.sched_setaffinity(0, processors)
    return found


def test_serve_warns_where_hidden_and_public_phases_share_workers() -> None:
    assert "[work] phase_kinds" in describe_mixed_phases("all", frozenset({True, False}))
    assert describe_mixed_phases("all", frozenset({True})) == ""
    assert describe_mixed_phases("hidden", frozenset({True, False})) == ""


def test_the_setting_has_three_values() -> None:
    assert load_settings(None, {"MDRIVE_WORK__PHASE_KINDS": "hidden"}).work.phase_kinds == "hidden"
    assert ServerSettings().work.phase_kinds == "all"
    with pytest.raises(InputError, match=r"work\.phase_kinds"):
        load_settings(None, {"MDRIVE_WORK__PHASE_KINDS": "some"})
