"""What connections that stay open cost a server: `python tests/bench/streams.py [SECONDS] [CONNECTIONS.STREAMS]`.

A server in a process of its own, without workers. First it is quiet; then 150 teams try to hold 16 event streams each
(2400); then, beside the streams that it accepted, 3000 connections at once that send nothing, or a byte, opened again a
second after the server has closed them: from the address of a proxy, from another one, from thousands. Meanwhile a
visitor asks for /health ten times a second on connections of its own. Printed: streams accepted, the server's CPU time
per second, median and maximum of /health. A second argument sets `connections.streams` and its limit per team out of
reach, as before these limits existed; 0 leaves the streams out. On a busy machine begin it with `nice -n -15`.
"""

import asyncio
import json
import os
import select
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import click

PATHS = [str(folder) for folder in Path(__file__).resolve().parents[:3]]
sys.path[:0] = PATHS

from attacks import API, PROGRAM, SETTINGS  # noqa: E402
from submission import this_python  # noqa: E402

from server.cli.limited_protocol import raise_open_files  # noqa: E402
from server.clock import now_us  # noqa: E402
from server.enums import ChallengeTrack, TokenScope  # noqa: E402
from server.settings import ServerSettings  # noqa: E402
from server.store import Store, phases, submissions, teams, tokens  # noqa: E402

TEAMS, STREAMS, IDLE = 150, 16, 3000
ATTACK, HOLD = "--attack", "--hold"
MANY = "many"
SOURCES = {"a proxy's address": "127.0.0.1", "another address": "127.0.0.2", "many addresses": MANY}
WORDS = {"silent connections": "", "a byte each": "G"}
TICKS = os.sysconf("SC_CLK_TCK")


@contextmanager
def serving(folder: Path, more: str) -> Iterator[tuple[str, int]]:
    """A running server; its address and process."""
    file = folder / "settings.toml"
    file.write_text(SETTINGS + more)
    command = [sys.executable, "-c", PROGRAM, "--settings", str(file), "--data", str(folder / "data")]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        line = next(line for line in process.stderr if "running on" in line)
        threading.Thread(target=process.stderr.read, daemon=True).start()
        yield line.split("http://")[1].split()[0], process.pid
    finally:
        process.kill()
        process.wait(30)


def prepare(folder: Path) -> list[tuple[str, str]]:
    """A token and a queued submission of each team."""
    settings = ServerSettings(data=folder / "data")
    this_python(settings.data)
    store, held = Store(settings.database_url), list[tuple[str, str]]()
    with store.write() as session:
        phase = phases.get(session, "dev")
        for number in range(TEAMS):
            team = teams.create(session, f"team {number}", now_us())
            environment = "python3.11-numpy"
            new = submissions.NewSubmission(
                team.id, ChallengeTrack.SINGLE, "m", f"{number:064x}", 1, environment, {"version": "1"}
            )
            mine = submissions.accept(session, new, phase, [("s", 0)], now_us()).id
            held.append((tokens.issue(session, team, TokenScope.SUBMIT, now_us()), mine))
    store.close()
    return held


class Attack:
    """Connections of a process of its own: a client shares no interpreter with the visitor who measures."""

    def __init__(self, address: str) -> None:
        self._host, _, self._port = address.partition(":")
        self.accepted = self.refused = 0

    async def run(self, held: list[tuple[str, str]]) -> None:
        """Open the streams; print counts after each line of input."""
        tasks = [asyncio.create_task(self._stream(token, mine)) for token, mine in held * STREAMS]
        while await asyncio.to_thread(sys.stdin.readline):
            click.echo(f"{self.accepted} {self.refused}")
        del tasks  # kept until here: the event loop alone does not keep tasks

    async def _stream(self, token: str, mine: str) -> None:
        try:
            await self._hold_stream(token, mine)
        except OSError:  # closed before it was answered
            self.refused += 1

    async def _hold_stream(self, token: str, mine: str) -> None:
        reader, writer = await asyncio.open_connection(self._host, int(self._port))
        request = f"GET {API}/submissions/{mine}/events HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n\r\n"
        writer.write(request.encode())
        if b" 200 " not in await reader.readline():
            self.refused += 1
            writer.close()
            return
        self.accepted += 1
        with suppress(OSError):
            await self._read(reader)

    @staticmethod
    async def _read(reader: asyncio.StreamReader) -> None:
        while await reader.read(65536):
            pass


class Holder:
    """Opens connections without waiting for one another, says a word on each, and opens them again."""

    def __init__(self, address: str, source: str, words: str) -> None:
        host, _, port = address.partition(":")
        self._to, self._source, self._words = (host, int(port)), source, words.encode()
        self._poller, self._lines, self._opened = select.epoll(), dict[int, socket.socket](), 0

    def run(self) -> None:
        """Until the process is ended."""
        due = [0.0] * IDLE
        while True:
            while due and due[0] < time.monotonic():
                due.pop(0)
                self._open()
            due += [time.monotonic() + 1.0 for fd, events in self._poller.poll(0.1) if not self._go_on(fd, events)]

    def _open(self) -> None:
        number, line = self._opened, socket.socket()
        line.setblocking(False)
        line.bind((f"127.1.{number // 250 % 250}.{1 + number % 250}" if self._source == MANY else self._source, 0))
        line.connect_ex(self._to)
        self._lines[line.fileno()] = line
        self._opened += 1
        self._poller.register(line, select.EPOLLOUT | select.EPOLLIN | select.EPOLLRDHUP)

    def _go_on(self, fd: int, events: int) -> bool:
        """Say the word once it is open; whether it still is."""
        if events & ~select.EPOLLOUT:
            self._lines.pop(fd).close()
            return False
        with suppress(OSError):
            self._lines[fd].send(self._words)
        self._poller.modify(fd, select.EPOLLIN | select.EPOLLRDHUP)
        return True


@contextmanager
def holding(address: str, source: str, words: str) -> Iterator[None]:
    """Run a `Holder`."""
    command = [sys.executable, str(Path(__file__).resolve()), HOLD, address, source, words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdout.readline()  # its imports take longer than the attack
        process.stdin.write(b"\n")
        process.stdin.flush()
        try:
            yield
        finally:
            process.kill()


@contextmanager
def attacking(address: str, held: list[tuple[str, str]]) -> Iterator[Callable[[], list[int]]]:
    """Run the attack; each call of the result returns its counts."""
    command = [sys.executable, str(Path(__file__).resolve()), ATTACK, address]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stdout is not None
    to, answers = process.stdin, process.stdout
    to.write(json.dumps(held) + "\n")
    to.flush()

    def count() -> list[int]:
        to.write("\n")
        to.flush()
        return [int(word) for word in answers.readline().split()]

    try:
        yield count
    finally:
        process.kill()
        process.wait()


def cpu_s(pid: int) -> float:
    """CPU time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def measure(name: str, address: str, pid: int, seconds: float) -> None:
    """Ask for /health and print a row."""
    begin, before, health, resets = time.monotonic(), cpu_s(pid), list[float](), 0
    host, _, port = address.partition(":")
    while time.monotonic() < begin + seconds:
        since = time.perf_counter()
        try:
            with socket.create_connection((host, int(port)), 60) as line:
                line.sendall(f"GET {API}/health HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode())
                answer = line.recv(65536)
        except ConnectionError:
            resets += 1
            continue
        health.append((time.perf_counter() - since) * 1e3)
        assert answer.startswith(b"HTTP/1.1 200"), answer
        time.sleep(0.1)
    share = (cpu_s(pid) - before) / (time.monotonic() - begin)
    middle = statistics.median(health)
    figures = f"/health {len(health)} x  median {middle:.0f} ms  max {max(health):.0f} ms  resets {resets}"
    click.echo(f"{name:40} CPU {share:.2f}  {figures}")


def measure_streams(address: str, pid: int, seconds: float, held: list[tuple[str, str]]) -> None:
    """Print the rows of the streams."""
    with attacking(address, held) as count:
        measure("while streams are opened", address, pid, seconds)
        while sum(counts := count()) < TEAMS * STREAMS:
            time.sleep(0.5)
        click.echo(f"streams: {counts[0]} accepted, {counts[1]} refused")
        measure("with these streams", address, pid, seconds)
        measure_connections(address, pid, seconds)


def measure_connections(address: str, pid: int, seconds: float) -> None:
    """Print the rows of connections without a request."""
    for what, words in WORDS.items():
        for where, source in SOURCES.items():
            with holding(address, source, words):
                measure(f"{what}, {where}", address, pid, seconds)
            time.sleep(3)  # until the server has closed them


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] in ([ATTACK], [HOLD]):
        raise_open_files(4000)
        if sys.argv[1] == HOLD:
            click.echo("ready")
            sys.stdin.readline()
            Holder(*sys.argv[2:]).run()
        asyncio.run(Attack(sys.argv[2]).run(json.loads(sys.stdin.readline())))
        return
    seconds, streams = float((sys.argv[1:2] or ["15"])[0]), (sys.argv[2:] or [""])[0]
    more = f"[connections]\ntotal = 9000\nstreams = {streams}\n" if streams not in ("", "0") else ""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as scratch, serving(Path(scratch), more) as (address, pid):
        click.echo("load " + " ".join(f"{load:.1f}" for load in os.getloadavg()))
        measure("quiet", address, pid, seconds)
        if streams == "0":
            measure_connections(address, pid, seconds)
        else:
            measure_streams(address, pid, seconds, prepare(Path(scratch)))


if __name__ == "__main__":
    main()
