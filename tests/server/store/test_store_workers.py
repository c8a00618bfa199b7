"""Workers are listed while they live."""

from pathlib import Path

import pytest
from testing import databases, evaluation_fakes
from testing.store_samples import S

from mdrive_sumo import __version__
from mdrive_sumo.runs.process_pool import ProcessPool
from server.evaluation.dispatcher import Dispatcher, StopRequest
from server.phase_suites import LoadedPhaseSuites
from server.store import Store, workers


@pytest.fixture(params=databases.BACKENDS)
def store(request: pytest.FixtureRequest) -> Store:
    return databases.emptied(request.param)


def owners(store: Store) -> list[str]:
    with store.read() as session:
        return [worker.owner for worker in workers.list_workers(session)]


def test_one_signs_in_with_every_beat_and_is_forgotten_an_hour_after_the_last(store: Store) -> None:
    with store.write() as session:
        workers.record_heartbeat(session, "a", "", 1)
        workers.record_heartbeat(session, "b", "tcp://there", 2)
    with store.write() as session:
        workers.record_heartbeat(session, "b", "tcp://there", 5 * S)
    with store.read() as session:
        a, b = workers.list_workers(session)
        assert (a.owner, a.started_us, a.seen_us, a.scheduler, a.version) == ("a", 1, 1, "", __version__)
        assert (b.started_us, b.seen_us, b.scheduler) == (2, 5 * S, "tcp://there")
    with store.write() as session:
        workers.record_heartbeat(session, "b", "tcp://there", workers.FORGET_AFTER_US + 2)
        assert workers.count_alive(session, S, workers.FORGET_AFTER_US + 2 + S) == 1
        assert workers.count_alive(session, S, workers.FORGET_AFTER_US + 3 + S) == 0
    assert owners(store) == ["b"]
    with store.write() as session:
        workers.remove_worker(session, "b")
    assert owners(store) == []


def test_a_dispatcher_is_listed_without_work_and_leaves_when_it_ends(store: Store, tmp_path: Path) -> None:
    options = evaluation_fakes.challenge(tmp_path, store, "nap")
    now = [1_000 * S]
    stop = StopRequest()
    with ProcessPool(evaluation_fakes.fake, 1, 60.0) as pool:
        dispatcher = Dispatcher(store, options, LoadedPhaseSuites(options), pool, "me", lambda: now[0])
        dispatcher.step(0.0, stop)
        now[0] += options.work.heartbeat_s * S
        dispatcher.step(0.0, stop)
        with store.read() as session:
            (found,) = workers.list_workers(session)
            assert (found.owner, found.started_us, found.seen_us) == ("me", 1_000 * S, 1_010 * S)
        stop.request()
        dispatcher.run(stop)
    assert owners(store) == []
