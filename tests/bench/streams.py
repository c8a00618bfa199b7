"""What connections that stay open cost a server: `python tests/bench/streams.py [SECONDS] [CONNECTIONS.STREAMS]`.

A server in a process of its own, without workers. First it is quiet; then 150 teams try to hold 16 event streams each
(2400); then, beside the streams that it accepted, 3000 connections are opened that send nothing, opened again as soon
as the server closes them. Meanwhile a visitor asks for /health ten times a second on connections of its own. Printed:
streams accepted, the server's CPU time per second, median and maximum of /health. A second argument sets
`connections.streams` and its limit per team out of reach, as before these limits existed.
"""

import asyncio
import json
import os
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
ATTACK, MORE = "--attack", "more"
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
        self.accepted = self.refused = self.reopened = 0

    async def run(self, held: list[tuple[str, str]]) -> None:
        """Open the streams; after a line `MORE` the silent connections; print counts after each line of input."""
        tasks = [asyncio.create_task(self._stream(token, mine)) for token, mine in held * STREAMS]
        while line := await asyncio.to_thread(sys.stdin.readline):
            if line.strip() == MORE:
                tasks += [asyncio.create_task(self._stay()) for _ in range(IDLE)]
            click.echo(f"{self.accepted} {self.refused} {self.reopened}")

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

    async def _stay(self) -> None:
        while True:
            try:
                reader, writer = await asyncio.open_connection(self._host, int(self._port))
                await reader.read(1)
                writer.close()
            except OSError:
                pass
            await asyncio.sleep(1.0)
            self.reopened += 1


@contextmanager
def attacking(address: str, held: list[tuple[str, str]]) -> Iterator[Callable[[str], list[int]]]:
    """Run the attack; each call of the result returns its counts, and with `MORE` begins the silent connections."""
    command = [sys.executable, str(Path(__file__).resolve()), ATTACK, address]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stdout is not None
    to, answers = process.stdin, process.stdout
    to.write(json.dumps(held) + "\n")
    to.flush()

    def count(what: str = "") -> list[int]:
        to.write(f"{what}\n")
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
    click.echo(f"{name:28} CPU {share:.2f}  {figures}")


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == [ATTACK]:
        raise_open_files(4000)
        asyncio.run(Attack(sys.argv[2]).run(json.loads(sys.stdin.readline())))
        return
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 15.0
    more = f"[connections]\ntotal = 9000\nstreams = {sys.argv[2]}\n" if len(sys.argv) > 2 else ""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as scratch, serving(Path(scratch), more) as (address, pid):
        held = prepare(Path(scratch))
        measure("quiet", address, pid, seconds)
        with attacking(address, held) as count:
            measure("while streams are opened", address, pid, seconds)
            while sum((counts := count(""))[:2]) < TEAMS * STREAMS:
                time.sleep(0.5)
            click.echo(f"streams: {counts[0]} accepted, {counts[1]} refused")
            measure("with these streams", address, pid, seconds)
            count(MORE)
            measure("and silent connections", address, pid, seconds)
            click.echo(f"silent connections: {count('')[2]} opened again")


if __name__ == "__main__":
    main()
