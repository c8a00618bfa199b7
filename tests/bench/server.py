"""How fast the server answers: `python tests/bench/server.py [--workers N] [--rounds N] [--boards HOW]`.

A server in a process of its own with 10 000 submissions stored. Measured are 5 uploads of 50 MB, from the last byte
sent to the answer read, and leaderboards (overall, by track, bucket and category by turns), of the API and as pages,
asked for by 50 clients that each ask again as soon as they are answered. Before each round a team is hidden, which
changes every board, and 0 to 5 s pass. `--workers N`: meanwhile N workers evaluate what was uploaded, the sample agent,
in boxes. `--boards`: `cached` as they are served; `uncached` without the answers in memory; `in-process` with them,
but built by a thread of the server on request instead of a process in advance.
"""

import argparse
import asyncio
import os
import random
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import httpx

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from store import BUCKETS, CATEGORIES, TEAMS, filled  # noqa: E402
from submission import sample, this_python  # noqa: E402
from testing.processes import wait_for  # noqa: E402
from testing.store_samples import PHASE, with_teams  # noqa: E402

from server.clock import now_us  # noqa: E402
from server.enums import JobState, TokenScope  # noqa: E402
from server.settings import ServerSettings, WorkerSettings  # noqa: E402
from server.store import Store, queries, teams, tokens  # noqa: E402

BOARDS = {"leaderboards": f"/api/v1/leaderboards/{PHASE.id}?", "leaderboard pages": f"/?phase={PHASE.id}"}
UPLOADS, UPLOAD_BYTES, CLIENTS, REQUESTS = 5, 50_000_000, 50, 40
BOUNDARY = "bench"
PAUSES_S = (0.0, 0.5, 5.0)
TARGET_MS = 100.0
PROGRAM = """
import asyncio, sys, uvicorn
from server.api import leaderboard_cache
from server.api.leaderboard_cache import DirectDatabaseReader
from server.api.response_cache import ResponseCacheMiddleware
from server.cli.serve_command import SWITCH_S
from server.web.mount_pages import mount_pages
from server.api.app import create_app
from server.evaluation.supervisor import Supervisor
from server.settings import ServerSettings
settings = ServerSettings.model_validate_json(sys.argv[1])
boards = sys.argv[2]
if boards == "in-process":
    leaderboard_cache.LeaderboardCache.refresh_forever = lambda self, now: asyncio.Event().wait()
app = create_app(settings)
mount_pages(app)
if boards == "uncached":
    app.user_middleware = [each for each in app.user_middleware if each.cls is not ResponseCacheMiddleware]
if boards == "in-process":
    app.state.services.leaderboards._reader = DirectDatabaseReader(app.state.services.store)
sys.setswitchinterval(SWITCH_S)
supervisor = Supervisor(app.state.services.store, settings)
supervisor.start()
try:
    uvicorn.run(app, port=0, log_level="info", access_log=False)
finally:
    supervisor.stop()
"""


@contextmanager
def serving(settings: ServerSettings, boards: str) -> Generator[tuple[httpx.URL, int]]:
    """A server; its address and process."""
    log, command = settings.data / "log", [sys.executable, "-c", PROGRAM, settings.model_dump_json(), boards]
    with log.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    try:
        while "running on http://" not in (text := log.read_text()):
            assert process.poll() is None, text
            time.sleep(0.1)
        yield httpx.URL(text.split("running on ")[1].split()[0]), process.pid
    finally:
        process.terminate()
        process.wait()


def archive(folder: Path, number: int) -> Path:
    """The sample with 50 MB of weights, of which nothing can be compressed."""
    path = folder / f"{number}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        for name, content in sample().items():
            file.writestr(name, content)
        for part in range(5):
            file.writestr(f"weights/{part}.bin", random.Random(5 * number + part).randbytes(UPLOAD_BYTES // 5))
    return path


def uploaded(address: httpx.URL, path: Path, token: str) -> float:
    """Seconds from the last byte to the answer."""
    fields = {"phase": PHASE.id, "track": "single-agent", "name": "bench"}
    head = "".join(
        f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"\r\n\r\n{value}\r\n'
        for name, value in fields.items()
    )
    head += f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="archive"; filename="a.zip"\r\n\r\n'
    sent_s = 0.0

    def content() -> Generator[bytes]:
        nonlocal sent_s
        yield head.encode()
        with path.open("rb") as file:
            while piece := file.read(1 << 16):
                yield piece
        sent_s = time.perf_counter()
        yield f"\r\n--{BOUNDARY}--\r\n".encode()

    headers = {"Authorization": f"Bearer {token}", "Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
    answer = httpx.post(address.join("/api/v1/submissions"), content=content(), headers=headers, timeout=60)
    took_s = time.perf_counter() - sent_s
    assert answer.status_code == 201, answer.text
    return took_s


async def client(address: httpx.URL, board: str, number: int, took: list[float]) -> None:
    """Asks again and again over one connection."""
    reader, writer = await asyncio.open_connection(address.host, address.port)
    tails = ["", "&track=single-agent", *(f"&bucket={each}" for each in BUCKETS)]
    tails += [f"&category={each}" for each in CATEGORIES]
    for turn in range(REQUESTS):
        tail = tails[(number + turn) % len(tails)]
        begun_s = time.perf_counter()
        writer.write(f"GET {board}{tail} HTTP/1.1\r\nHost: bench\r\n\r\n".encode())
        header = await reader.readuntil(b"\r\n\r\n")
        assert header.startswith(b"HTTP/1.1 200"), header
        length = next(line for line in header.lower().split(b"\r\n") if line.startswith(b"content-length:"))
        await reader.readexactly(int(length.split(b":")[1]))
        took.append(time.perf_counter() - begun_s)
    writer.close()


def processor_s(pid: int) -> float:
    """CPU time of a process (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def asked(address: httpx.URL, pid: int, what: str, board: str) -> float:
    """Prints what 50 clients wait; returns the 99th percentile in ms."""
    took: list[float] = []
    used_s = processor_s(pid)
    begun_s = time.perf_counter()
    await asyncio.gather(*(client(address, board, number, took) for number in range(CLIENTS)))
    wall_s = time.perf_counter() - begun_s
    own_ms = (processor_s(pid) - used_s) / len(took) * 1e3
    took.sort()
    p50, p99 = took[len(took) // 2] * 1e3, took[len(took) * 99 // 100] * 1e3
    print(  # noqa: T201
        f"{what}, {CLIENTS} clients: p50 {p50:.1f} ms  p99 {p99:.1f} ms  {len(took) / wall_s:.0f} a second"
        f"  CPU of the server {own_ms:.2f} ms each  load {os.getloadavg()[0]:.1f}"
    )
    return p99


def change(store: Store, number: int) -> None:
    """Of every board."""
    with store.write() as session:
        teams.set_hidden(session, teams.get(session, f"team {number}").id, True, now_us())


def evaluated(store: Store) -> tuple[int, int]:
    """Scenarios that are driven, and those that are still to be driven."""
    with store.read() as session:
        counts = queries.count_by_state(session)[1]
    return counts.get(JobState.DONE, 0), counts.get(JobState.QUEUED, 0) + counts.get(JobState.RUNNING, 0)


def main() -> None:
    """All of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--boards", choices=("cached", "uncached", "in-process"), default="cached")
    given = parser.parse_args()
    workers = given.workers
    with tempfile.TemporaryDirectory() as folder:
        settings = ServerSettings(data=Path(folder), work=WorkerSettings(processes=workers, spot_check=0.0))
        store = Store(settings.database_url)
        store.migrate()
        filled(store, with_teams(store, *(f"team {number}" for number in range(TEAMS))), random.Random(0), queued=0)
        names = [f"sender {number}" for number in range(UPLOADS)]
        with store.write() as session:
            at_us = now_us()
            senders = [
                tokens.issue(session, teams.create(session, name, at_us), TokenScope.SUBMIT, at_us) for name in names
            ]
        this_python(settings.data)
        archives = [archive(settings.data, number) for number in range(UPLOADS)]
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {workers} workers")  # noqa: T201
        with serving(settings, given.boards) as (address, pid):
            took = [uploaded(address, path, token) for path, token in zip(archives, senders, strict=True)]
            text = "  ".join(f"{each:.2f}" for each in took)
            print(f"upload of {UPLOAD_BYTES} bytes, from the last byte to the answer [s]: {text}")  # noqa: T201
            wait_for(lambda: not workers or evaluated(store)[0] > 0, 120.0)
            slow = 0
            for number in range(given.rounds):
                pause_s, (what, board) = PAUSES_S[number // 2 % len(PAUSES_S)], list(BOARDS.items())[number % 2]
                change(store, number)
                time.sleep(pause_s)
                text = f"{what} {pause_s:g} s after a change"
                slow += asyncio.run(asked(address, pid, text, board)) > TARGET_MS
            print(f"boards {given.boards}: {slow} of {given.rounds} rounds above {TARGET_MS:g} ms (p99)")  # noqa: T201
            driven, left = evaluated(store)
            assert not workers or left > 0, "the workers had nothing to do in the end"
            print(f"scenarios driven meanwhile: {driven}; to be driven: {left}")  # noqa: T201
        store.close()


if __name__ == "__main__":
    main()
