"""What keeps answers quick: one thread reads boards, replay pages keep no upload waiting, threads take short turns."""

import asyncio
import sys
import threading
from pathlib import Path

import pytest
from api_app import Server, TestClient
from store_samples import NOON

from server.api import app, boards, create_app
from server.settings import Settings
from server.store import audit


def test_boards_are_read_by_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(tmp_path)
    readers: list[int] = []
    renewed = boards.renewed
    monkeypatch.setattr(boards, "renewed", lambda *words: readers.append(threading.get_ident()) or renewed(*words))
    found = boards.Boards(server.store)

    async def asked() -> None:
        wanted = [boards.Which("dev", None, f"bucket {number}", None) for number in range(20)]
        await asyncio.gather(*(found.board(which, NOON) for which in wanted))

    asyncio.run(asked())
    assert len(readers) == 20 and len(set(readers)) == 1
    found.close()
    with pytest.raises(RuntimeError, match="shutdown"):
        asyncio.run(found.board(boards.Which("dev", None, None, None), NOON))


def test_one_look_serves_all_boards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server(tmp_path)
    looks: list[object] = []
    head = audit.head
    found = boards.Boards(server.store)

    async def asked(now_us: int) -> None:
        wanted = [boards.Which("dev", None, f"bucket {number}", None) for number in range(20)]
        await asyncio.gather(*(found.board(which, now_us + number) for number, which in enumerate(wanted)))

    asyncio.run(asked(NOON))
    monkeypatch.setattr(audit, "head", lambda session: looks.append(session) or head(session))
    asyncio.run(asked(NOON + 2 * boards.STALE_US))
    assert len(looks) == 1
    server.send()
    looks.clear()
    asyncio.run(asked(NOON + 4 * boards.STALE_US))
    assert len(looks) == 20, "something happened: each is made anew"


def test_a_replay_page_keeps_no_upload_waiting(tmp_path: Path) -> None:
    tools = create_app(Settings(data=tmp_path)).state.tools
    assert tools.painter is not tools.aside


def test_threads_take_short_turns_while_it_serves(tmp_path: Path) -> None:
    before_s = sys.getswitchinterval()
    with TestClient(Server(tmp_path).app):
        assert sys.getswitchinterval() == pytest.approx(app.SWITCH_S)
    assert sys.getswitchinterval() == pytest.approx(before_s)
