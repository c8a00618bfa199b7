"""Requests and bodies that do not end, responses without bodies, and uploads at the same time."""

import asyncio
import socket
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedReader
from typing import Any
from unittest.mock import patch

import httpx
import pytest
from testing.api_app import API, Server, another_zip, listening

from server.api import request_bodies
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.problems import ProblemError
from server.api.upload import MAX_UPLOADS
from server.cli import serve_command
from server.cli.serve_command import TimeoutProtocol

pytestmark = pytest.mark.slow


def test_heads_without_bodies(server: Server) -> None:
    with listening(server) as address:
        asked, headed = (
            httpx.get(f"{address}{API}/phases", timeout=60),
            httpx.head(f"{address}{API}/phases", timeout=60),
        )
        assert headed.status_code == 200 and headed.content == b""
        assert headed.headers["content-length"] == asked.headers["content-length"] == str(len(asked.content))
        assert httpx.head(f"{address}{API}/submissions/{'0' * 32}/events", timeout=60).status_code == 405


def test_a_body_that_does_not_end_is_not_waited_for(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request_bodies, "JSON_S", 0.2)
    monkeypatch.setattr(request_bodies, "_DRAIN_S", 0.2)
    with listening(server) as address, socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as line:
        line.settimeout(20)
        head = f"POST {API}/tokens HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\nContent-Type: application/json\r\n"
        line.sendall(f"{head}Authorization: Bearer {server.tokens['admin']}\r\n\r\n{{".encode())
        assert line.recv(4096).startswith(b"HTTP/1.1 408")


def test_a_stream_is_not_taken_for_a_body_that_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stream waits for the client to leave, also where the middleware has read the body's end."""
    monkeypatch.setattr(request_bodies, "JSON_S", 0.01)
    gone, waits = asyncio.Event(), asyncio.Event()
    arrived = [{"type": "http.request", "body": b"", "more_body": False}]

    async def receive() -> dict[str, Any]:
        if waits.is_set() and arrived:
            return arrived.pop()
        waits.set()
        await gone.wait()
        return {"type": "http.disconnect"}

    async def streamed() -> str:
        body = request_bodies._Body(receive, 100)
        leaving = asyncio.create_task(body.receive())
        await waits.wait()
        await body.drain(1)
        await asyncio.sleep(0.1)
        gone.set()
        return (await leaving)["type"]

    assert asyncio.run(streamed()) == "http.disconnect"


@contextmanager
def impatient(server: Server, good: bytes) -> Generator[tuple[socket.socket, BufferedReader]]:
    """A connection with a good request behind it; from now on the next one is waited for a second only."""
    with listening(server, http=TimeoutProtocol) as address:
        line = socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), 60)
        with line, line.makefile("rb") as answers:
            line.sendall(good)
            assert read_one(answers) == 200
            with patch.object(serve_command, "REQUEST_S", 1.0):
                yield line, answers


def test_a_request_that_does_not_end_is_not_waited_for(server: Server) -> None:
    """Neither is one after a good one."""
    good = f"GET {API}/phases HTTP/1.1\r\nHost: x\r\n\r\n".encode()
    with impatient(server, good) as (line, answers):
        line.sendall(good)
        assert read_one(answers) == 200
        with suppress(ConnectionError):  # it may be closed already
            line.sendall(good[:20])
            assert answers.read() == b""


def test_a_request_in_hand_is_not_cut(server: Server) -> None:
    """The time for the next one begins with each answer; here the next one is there by then, and takes longer."""

    @server.app.get("/slow")
    async def slow() -> str:
        await asyncio.sleep(2.5)
        return "done"

    good, long = (f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode() for path in (f"{API}/phases", "/slow"))
    with impatient(server, good) as (line, answers):
        line.sendall(good + long)
        assert [read_one(answers), read_one(answers)] == [200, 200]


def read_one(answers: BufferedReader) -> int:
    """Status of the next answer of a connection."""
    status = int(answers.readline().split()[1])
    length = 0
    while header := answers.readline().strip():
        if header.lower().startswith(b"content-length:"):
            length = int(header.split()[1])
    answers.read(length)
    return status


def at_once(count: int, deed: Callable[[int], int]) -> list[int]:
    async def all_of_them() -> list[int]:
        return await asyncio.gather(*(asyncio.to_thread(deed, number) for number in range(count)))

    return asyncio.run(all_of_them())


def test_a_quota_cannot_be_passed_together(server: Server) -> None:
    """Two at a time are allowed."""

    with listening(server) as address:

        def upload(number: int) -> int:
            files = {"archive": ("team.zip", another_zip(number))}
            form = {"phase": "dev", "track": "single-agent", "name": "method"}
            headers = {"Authorization": f"Bearer {server.tokens['red']}"}
            return httpx.post(
                f"{address}{API}/submissions", data=form, files=files, headers=headers, timeout=60
            ).status_code

        assert sorted(at_once(6, upload)) == [201, 201, 429, 429, 429, 429]


def test_an_idempotency_key_holds_for_uploads_at_once(server: Server) -> None:

    with listening(server) as address:

        def upload(_: int) -> int:
            files = {"archive": ("team.zip", another_zip(1))}
            form = {"phase": "dev", "track": "single-agent", "name": "method"}
            headers = {"Authorization": f"Bearer {server.tokens['red']}", "Idempotency-Key": "once"}
            answer = httpx.post(f"{address}{API}/submissions", data=form, files=files, headers=headers, timeout=60)
            return answer.status_code

        assert at_once(5, upload) == [201] * 5
    assert len(server.get("/submissions", "red")["items"]) == 1


def test_a_team_uploads_a_few_at_a_time() -> None:
    uploads = ConcurrencyLimit("upload", MAX_UPLOADS)
    with ExitStack() as stack:
        for _ in range(MAX_UPLOADS):
            stack.enter_context(uploads.acquire("red"))
        with pytest.raises(ProblemError, match=f"at most {MAX_UPLOADS} of a team"), uploads.acquire("red"):
            pass
        with uploads.acquire("blue"):
            pass
    with uploads.acquire("red"):
        pass
