"""Requests and bodies that do not end, responses without bodies, and uploads at the same time."""

import asyncio
import socket
import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedReader
from typing import Any
from unittest.mock import patch

import httpx
import pytest
from testing.api_app import API, Server, another_zip, listening
from testing.processes import wait_for

from server.api import request_bodies
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.problems import ProblemError
from server.cli import limited_protocol
from server.cli.limited_protocol import LimitedProtocol, name_origin

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
    with listening(server, http=LimitedProtocol) as address:
        line = socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), 60)
        with line, line.makefile("rb") as answers:
            line.sendall(good)
            assert read_one(answers) == 200
            with patch.object(limited_protocol, "REQUEST_S", 1.0):
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
    uploads = ConcurrencyLimit("upload", 8, 64)
    with ExitStack() as stack:
        for _ in range(8):
            stack.enter_context(uploads.acquire("red"))
        with pytest.raises(ProblemError, match="at most 8 of a team"), uploads.acquire("red"):
            pass
        with uploads.acquire("blue"):
            pass
    with uploads.acquire("red"):
        pass


def test_teams_that_take_all_leave_places_for_others() -> None:
    """Dynamic thresholds: a team gets at most half of what it finds free, and one that has none the last place."""
    limit = ConcurrencyLimit("stream", 16, 40)
    with ExitStack() as stack:

        def take(team: str) -> int:
            count = 0
            with suppress(ProblemError):
                while True:
                    stack.enter_context(limit.acquire(team))
                    count += 1
            return count

        assert [take(team) for team in ("red", "green", "blue", "red", "honest")] == [16, 12, 6, 0, 3]
        for number in range(60):
            take(f"team-{number}")
        assert limit.running == 40
        with pytest.raises(ProblemError, match=r"too many of all teams at a time \(at most 40\)") as refused:
            stack.enter_context(limit.acquire("late"))
        assert refused.value.status == 503 and refused.value.headers["Retry-After"] == "30"
    assert limit.running == 0


@pytest.mark.parametrize("pages", [False, True], ids=["api", "page"])
def test_an_aborted_upload_is_one_line_in_the_log(
    server: Server, pages: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """It was a traceback of 84 lines."""
    if pages:
        server.mount_pages()
    who = {"Cookie": f"mdrive_token={server.tokens['red']}"} if pages else {}
    path = "/submit" if pages else f"{API}/submissions"
    headers = {"Host": "x", "Origin": "http://x", "Content-Type": "multipart/form-data; boundary=b", **who}
    headers |= {"Authorization": f"Bearer {server.tokens['red']}", "Content-Length": "50000"}
    lines = [f"POST {path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    part = '--b\r\nContent-Disposition: form-data; name="archive"; filename="x"\r\n\r\n' + "x" * 5000
    with listening(server) as address:
        with socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as line:
            line.sendall(("\r\n".join(lines) + "\r\n\r\n" + part).encode())
            wait_for(lambda: list(server.settings.archives.glob("*.part")) != [], 60.0)
        wait_for(lambda: "left" in caplog.text, 60.0)
        wait_for(lambda: list(server.settings.archives.iterdir()) == [], 60.0)
    (record,) = [record for record in caplog.records if record.levelname in ("WARNING", "ERROR")]
    assert record.getMessage() == f"'POST {path}': the client left before its request was complete"
    assert record.exc_info is None


def test_a_body_that_trickles_is_not_waited_for_longer(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit is of the whole body: a byte every now and then does not prolong it."""
    monkeypatch.setattr(request_bodies, "JSON_S", 0.3)
    monkeypatch.setattr(request_bodies, "_DRAIN_S", 0.0)
    with listening(server) as address, socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as line:
        line.settimeout(0.1)
        head = f"POST {API}/register HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\nContent-Type: application/json\r\n"
        line.sendall(f"{head}\r\n".encode())
        for _ in range(100):
            line.sendall(b" ")
            with suppress(TimeoutError):
                assert line.recv(4096).startswith(b"HTTP/1.1 408")
                return
    raise AssertionError("it waited for 10 s")


def test_a_client_that_does_not_read_is_cut(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """A response waits in memory, and can hold a file."""
    monkeypatch.setattr(limited_protocol, "READ_S", 0.2)

    @server.app.get("/large")
    async def large() -> str:
        return "x" * 30_000_000

    with (
        listening(server, http=LimitedProtocol) as address,
        socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2]))) as line,
    ):
        line.sendall(b"GET /large HTTP/1.1\r\nHost: x\r\n\r\n")
        time.sleep(3)  # ample for a busy machine, on which the response may begin late
        line.settimeout(20)
        size = 0
        with suppress(ConnectionError):
            while data := line.recv(1 << 20):
                size += len(data)
        assert 0 < size < 30_000_000


def test_the_connection_that_waits_longest_makes_room(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clients that connect and say nothing do not keep others out; an upload and a stream under way stay."""
    mine = server.send().json()["id"]
    with listening(server, http=limited_protocol.limit_connections(6, 6)) as address, ExitStack() as stack:
        port = int(address.rpartition(":")[2])
        token = {"Authorization": f"Bearer {server.tokens['red']}"}
        http = stack.enter_context(httpx.Client(timeout=60))
        stream = stack.enter_context(http.stream("GET", f"{address}{API}/submissions/{mine}/events", headers=token))
        upload = stack.enter_context(socket.create_connection(("127.0.0.1", port), 60))
        head = f"POST {API}/submissions HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n"
        head += f"Authorization: {token['Authorization']}\r\nContent-Type: multipart/form-data; boundary=b\r\n\r\n"
        upload.sendall(f"{head}--b".encode())
        monkeypatch.setattr(limited_protocol, "TRIM_S", 0.05)
        idle = [say(stack, port, b"G") for _ in range(9)]
        assert httpx.get(f"{address}{API}/health", timeout=60).status_code == 200
        with suppress(ConnectionError):
            assert idle[0].recv(1) == b""
        upload.sendall(b"nonsen")
        assert upload.recv(4096).startswith(b"HTTP/1.1 400")
        assert stream.status_code == 200 and not stream.is_closed
        assert next(stream.iter_lines()).startswith("id: ")


def say(stack: ExitStack, port: int, words: bytes, source: str = "127.0.0.1") -> socket.socket:
    """A connection from an address, on which so much has been said."""
    line = stack.enter_context(socket.create_connection(("127.0.0.1", port), 60, (source, 0)))
    line.sendall(words)
    return line


def is_refused(line: socket.socket) -> bool:
    with suppress(ConnectionError):
        return line.recv(1) == b""
    return True


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux waits for the first words")
def test_a_connection_that_says_nothing_stays_in_the_kernel(server: Server) -> None:
    """Three thousand of them at once silenced the server for 0.2 s of its own time."""
    protocol = limited_protocol.limit_connections(100, 100)
    with listening(server, http=protocol) as address, ExitStack() as stack:
        port = int(address.rpartition(":")[2])
        silent = [stack.enter_context(socket.create_connection(("127.0.0.1", port), 60)) for _ in range(20)]
        assert httpx.get(f"{address}{API}/health", timeout=60).status_code == 200
        spoken = say(stack, port, b"GET /")
        wait_for(lambda: spoken.getsockname() in peers(protocol), 60.0)
        assert not peers(protocol) & {line.getsockname() for line in silent}


def peers(protocol: type[LimitedProtocol]) -> set[object]:
    return {connection.transport.get_extra_info("peername") for connection in set(protocol.held)}


def test_an_address_has_so_many_connections_and_a_proxy_more(server: Server) -> None:
    protocol = limited_protocol.limit_connections(100, 3)
    with listening(server, http=protocol) as address, ExitStack() as stack:
        port, half = int(address.rpartition(":")[2]), b"GET "
        lines = [say(stack, port, half, "127.0.0.2") for _ in range(3)]
        wait_for(lambda: protocol.origins["127.0.0.2"] == 3, 60.0)
        assert is_refused(say(stack, port, half, "127.0.0.2"))
        request = f"GET {API}/health HTTP/1.1\r\nHost: x\r\n\r\n".encode()
        for source in ("127.0.0.3", *["127.0.0.1"] * 5):
            assert say(stack, port, request, source).recv(12) == b"HTTP/1.1 200"
        lines.pop().close()
        wait_for(lambda: protocol.origins["127.0.0.2"] == 2, 60.0)
        assert say(stack, port, request, "127.0.0.2").recv(12) == b"HTTP/1.1 200"


def test_beyond_the_total_only_requests_are_let_in(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are let in however many come, since those that say nothing make room."""
    monkeypatch.setattr(limited_protocol, "TRIM_S", 60.0)  # only what a new connection does is seen
    protocol = limited_protocol.limit_connections(8, 100)
    with listening(server, http=protocol) as address, ExitStack() as stack:
        port = int(address.rpartition(":")[2])
        half = [say(stack, port, b"GET ") for _ in range(8)]
        wait_for(lambda: len(protocol.held) == 8, 60.0)
        assert is_refused(say(stack, port, b"GET "))
        request = f"GET {API}/health HTTP/1.1\r\nHost: x\r\n\r\n".encode()
        for _ in range(30):
            assert say(stack, port, request).recv(12) == b"HTTP/1.1 200"
        assert all(map(is_refused, half)) and len(protocol.held) <= 10


@pytest.mark.parametrize(
    ("address", "other", "same"),
    [
        ("10.0.0.1", "10.0.0.2", False),
        ("2001:db8:0:1::1", "2001:db8:0:1:ffff::2", True),
        ("2001:db8:0:1::1", "2001:db8:0:2::1", False),
    ],
)
def test_an_address_of_ipv6_is_its_network(address: str, other: str, same: bool) -> None:
    assert (name_origin(address) == name_origin(other)) is same


def test_refused_uploads_do_not_keep_others_out(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their bodies could be awaited for as long as that of an archive: 15 minutes, and without a token."""
    monkeypatch.setattr(request_bodies, "_DRAIN_S", 0.1)
    with listening(server, http=limited_protocol.limit_connections(4, 4)) as address, ExitStack() as stack:
        port = int(address.rpartition(":")[2])
        head = f"POST {API}/submissions HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n-"
        for _ in range(8):
            line = stack.enter_context(socket.create_connection(("127.0.0.1", port), 60))
            line.sendall(head.encode())
            assert line.recv(4096).startswith(b"HTTP/1.1 401")
        assert httpx.get(f"{address}{API}/health", timeout=60).status_code == 200


def test_open_files_are_raised_as_far_as_possible(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, int]] = []
    monkeypatch.setattr("resource.setrlimit", lambda _, limits: given.append(limits))
    for limits, told in (((1024, 4096), 1000), ((1024, 1024), 384), ((9999, 9999), 1000), ((1024, -1), 1000)):
        monkeypatch.setattr("resource.getrlimit", lambda _, limits=limits: limits)
        assert limited_protocol.raise_open_files(1000) >= told
    assert given == [(2256, 4096), (1024, 1024), (2256, -1)]
