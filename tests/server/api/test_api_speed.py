"""What keeps answers quick: boards are made before anybody asks, and in another process; uploads wait for no page."""

import asyncio
import time
from pathlib import Path
from unittest.mock import patch

import pytest
from sqlalchemy.orm import Session
from testing.api_app import CLOSED, HIDDEN, Server
from testing.api_client import TestClient
from testing.store_samples import NOON, PHASE
from testing.web_page import driven

from server.api import leaderboard_cache
from server.api.app import create_app
from server.api.leaderboard_cache import DirectDatabaseReader, SubprocessDatabaseReader
from server.api.leaderboards import BoardKey
from server.api.problems import ProblemError
from server.settings import ServerSettings
from server.store import NotFound, Store, StoreUnavailable, audit, phases, teams

pytestmark = pytest.mark.slow

MANY = [BoardKey("dev", None, f"bucket {number}", None) for number in range(20)]


def looks(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Gets an entry with every look at the database for changes."""
    seen: list[object] = []
    last = audit.find_last
    monkeypatch.setattr(audit, "find_last", lambda *words: seen.append(words) or last(*words))
    return seen


def test_one_look_serves_all_boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(tmp_path)
    found, seen = leaderboard_cache.LeaderboardCache(DirectDatabaseReader(server.store)), looks(monkeypatch)

    async def asked(now_us: int) -> int:
        """How many looks that takes."""
        seen.clear()
        await asyncio.gather(*(found.get_json(which, now_us + number) for number, which in enumerate(MANY)))
        return len(seen)

    assert asyncio.run(asked(NOON)) == 20, "each is made"
    assert asyncio.run(asked(NOON + 2 * leaderboard_cache.STALE_US)) == 1
    server.send()
    assert asyncio.run(asked(NOON + 4 * leaderboard_cache.STALE_US)) == 1, "what is only queued is on no board"
    driven(server, "red", 50.0)
    assert asyncio.run(asked(NOON + 6 * leaderboard_cache.STALE_US)) == 20, "each is made anew"
    found.close()
    with pytest.raises(RuntimeError, match="shutdown"):
        asyncio.run(found.get_json(BoardKey("dev", None, None, None), NOON))


def test_boards_are_ready_before_anybody_asks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the start, and again after a change; those of phases that are over are not."""
    server = Server(tmp_path)
    server.mount_pages()
    driven(server, "red", 50.0)
    monkeypatch.setattr(leaderboard_cache, "REFRESH_S", 0.01)
    made: list[str] = []

    async def note(which: BoardKey, _: int) -> None:
        made.append(which.phase)

    server.app.state.services.leaderboards.add_builder(note)
    with TestClient(server.app) as client:
        assert set(made) == {PHASE.id, HIDDEN.id} and CLOSED.id not in made
        with patch.object(leaderboard_cache, "read_if_changed", side_effect=AssertionError("a request made a board")):
            for path in ("/api/v1/leaderboards/dev", "/?phase=dev", "/?phase=test", "/?phase=dev&track=negotiation"):
                assert client.get(path).status_code == 200
        driven(server, "blue", 60.0)
        server.now_us += leaderboard_cache.FRESH_US
        end = time.monotonic() + 60
        while "blue" not in client.get("/api/v1/leaderboards/dev").text:
            assert time.monotonic() < end
            time.sleep(0.01)


def test_boards_are_kept_through_a_time_without_a_database(tmp_path: Path) -> None:
    server = Server(tmp_path)
    found = leaderboard_cache.LeaderboardCache(DirectDatabaseReader(server.store))
    which = BoardKey("dev", None, None, None)

    async def asked() -> None:
        before = await found.get_json(which, NOON)
        with patch.object(leaderboard_cache, "read_if_changed", side_effect=StoreUnavailable("it went away")):
            await found.refresh_all(lambda: NOON + 2 * leaderboard_cache.FRESH_US)
            assert await found.get_json(which, NOON + 2 * leaderboard_cache.FRESH_US) == before
            with pytest.raises(StoreUnavailable):
                await found.get_json(which, NOON + 2 * leaderboard_cache.STALE_US)

    asyncio.run(asked())


def all_phases(session: Session) -> list[str]:
    return [phase.id for phase in phases.list_phases(session)]


def no_such_team(session: Session) -> None:
    teams.get(session, "nobody")


def too_long(session: Session) -> None:
    time.sleep(60)


@pytest.mark.full
def test_a_reader_in_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Answers, says that nothing changed, passes refusals on, and is begun anew where it hangs."""
    url = f"sqlite:///{tmp_path / 'a.sqlite'}"
    store = Store(url)
    store.migrate()
    apart = SubprocessDatabaseReader(url)
    try:
        stamp, found = apart.read(all_phases, None)
        assert (stamp, found) == ("", [])
        with store.write() as session:
            phases.set_phases(session, [PHASE], NOON)
        changed, found = apart.read(all_phases, stamp)
        assert changed != stamp and found == [PHASE.id]
        assert apart.read(all_phases, changed) == (changed, None)
        with pytest.raises(NotFound, match="'nobody'"):
            apart.read(no_such_team, None)
        monkeypatch.setattr(leaderboard_cache, "READ_S", 0.2)
        with pytest.raises(ProblemError, match="took longer than"):
            apart.read(too_long, None)
        monkeypatch.undo()
        assert apart.read(all_phases, None) == (changed, [PHASE.id])
    finally:
        apart.close()
        store.close()
    lost = SubprocessDatabaseReader(f"sqlite:///{tmp_path / 'none' / 'a.sqlite'}")
    with pytest.raises(StoreUnavailable):
        lost.read(all_phases, None)
    lost.close()


def test_a_replay_page_keeps_no_upload_waiting(tmp_path: Path) -> None:
    services = create_app(ServerSettings(data=tmp_path)).state.services
    assert services.replay_runner is not services.check_runner
