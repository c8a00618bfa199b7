"""How fast the server answers: `python tests/bench/server.py [--busy N]`.

A server in a process of its own with 10 000 submissions stored. Measured are 5 uploads of 50 MB, from the last byte
sent to the answer read, and leaderboards (overall, by track, bucket and category by turns), of the API and as pages,
asked for by 50 clients that each ask again as soon as they are answered. The first time each board is made; then it is
kept. `--busy N`: beside N processes that compute without end, as workers do.
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
from multiprocessing import Process
from pathlib import Path

import httpx

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from api_app import with_environment  # noqa: E402
from store import BUCKETS, CATEGORIES, TEAMS, filled  # noqa: E402
from store_samples import PHASE, with_teams  # noqa: E402

from server.clock import now_us  # noqa: E402
from server.settings import Settings  # noqa: E402
from server.store import Store, teams, tokens  # noqa: E402
from server.words import Scope  # noqa: E402

UPLOADS, UPLOAD_BYTES, CLIENTS, REQUESTS = 5, 50_000_000, 50, 40
BOUNDARY = "bench"
PROGRAM = """
import sys, uvicorn
from pathlib import Path
from server import web
from server.api import create_app
from server.settings import Settings
app = create_app(Settings(data=Path(sys.argv[1])))
web.mount(app)
uvicorn.run(app, port=0, log_level="info", access_log=False)
"""


@contextmanager
def serving(data: Path) -> Generator[tuple[httpx.URL, int]]:
    """A server; its address and process."""
    log = data / "log"
    with log.open("wb") as file:
        process = subprocess.Popen([sys.executable, "-c", PROGRAM, str(data)], stdout=file, stderr=subprocess.STDOUT)
    try:
        while "running on http://" not in (text := log.read_text()):
            assert process.poll() is None, text
            time.sleep(0.1)
        yield httpx.URL(text.split("running on ")[1].split()[0]), process.pid
    finally:
        process.terminate()
        process.wait()


def archive(folder: Path, number: int) -> Path:
    """A good one of 50 MB, of which nothing can be compressed."""
    path = folder / f"{number}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        file.writestr("agents.py", "class Agent:\n    pass\n")
        file.writestr("model_env.yaml", "environment: python3.11-numpy\n")
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


async def asked(address: httpx.URL, pid: int, what: str, board: str) -> None:
    """Prints what 50 clients wait."""
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
        f"  CPU of the server {own_ms:.2f} ms each"
    )


def compute() -> None:
    """Without end."""
    while True:
        sum(range(100_000))


def main() -> None:
    """All of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--busy", type=int, default=0)
    busy = [Process(target=compute, daemon=True) for _ in range(parser.parse_args().busy)]
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        store = Store(f"sqlite:///{data / 'challenge.sqlite'}")
        store.migrate()
        filled(store, with_teams(store, *(f"team {number}" for number in range(TEAMS))), random.Random(0))
        names = [f"sender {number}" for number in range(UPLOADS)]
        with store.write() as session:
            at_us = now_us()
            senders = [tokens.issue(session, teams.create(session, name, at_us), Scope.SUBMIT, at_us) for name in names]
        store.close()
        with_environment(Settings(data=data))
        archives = [archive(data, number) for number in range(UPLOADS)]
        for each in busy:
            each.start()
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, {len(busy)} processes of ours compute")  # noqa: T201
        with serving(data) as (address, pid):
            took = [uploaded(address, path, token) for path, token in zip(archives, senders, strict=True)]
            text = "  ".join(f"{each:.2f}" for each in took)
            print(f"upload of {UPLOAD_BYTES} bytes, from the last byte to the answer [s]: {text}")  # noqa: T201
            for _ in range(3):
                asyncio.run(asked(address, pid, "leaderboards", f"/api/v1/leaderboards/{PHASE.id}?"))
                asyncio.run(asked(address, pid, "leaderboard pages", f"/?phase={PHASE.id}"))


if __name__ == "__main__":
    main()
