"""What visitors and teams notice of attacks on the web server: `python tests/bench/attacks.py [SECONDS]`.

A server in a process of its own, without workers, in turn quiet and attacked: twelve anonymous clients that read the
scenarios of a submission with 225 overviews of the largest size without a pause, and eight connections of a team that
uploads archives that take long to check and are refused (without their quota, which would end the attack after 20).
Meanwhile a visitor asks for /health, and another team uploads good archives. Printed: median and maximum [ms].
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import httpx

PATHS = [str(folder) for folder in Path(__file__).resolve().parents[:3]]
sys.path[:0] = PATHS

from submission import this_python  # noqa: E402
from testing.api_app import another_zip  # noqa: E402
from testing.archive_samples import broken_at_its_end  # noqa: E402
from testing.store_samples import LEASE, S, summary  # noqa: E402

from server.clock import now_us  # noqa: E402
from server.enums import ChallengeTrack, ScenarioVerdict, TokenScope  # noqa: E402
from server.settings import ServerSettings  # noqa: E402
from server.store import Store, jobs, overviews, phases, submissions, teams, tokens  # noqa: E402
from server.store.jobs import JobOutcome  # noqa: E402

API = "/api/v1"
READERS, UPLOADERS = 12, 8
PROGRAM = "import sys; from server.cli import serve; serve(sys.argv[1:])"
SETTINGS = """
port = 0
[limits]
refused_per_day = 1000000
[work]
processes = 0
[[phases]]
id = "dev"
title = "Development"
suite = "mdrive"
public = true
opens = 2026-01-01T00:00:00Z
closes = 2099-01-01T00:00:00Z
per_day = 10000
in_parallel = 10000
in_total = 100000
"""


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """A running server; its address."""
    file = folder / "settings.toml"
    file.write_text(SETTINGS)
    command = [sys.executable, "-c", PROGRAM, "--settings", str(file), "--data", str(folder / "data")]
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert process.stderr is not None
    try:
        line = next(line for line in process.stderr if "running on" in line)
        threading.Thread(target=process.stderr.read, daemon=True).start()
        yield line.split("running on ")[1].split()[0]
    finally:
        process.terminate()
        process.wait(30)


def prepare(folder: Path) -> tuple[dict[str, str], str]:
    """Tokens, and a finished submission with the largest overviews."""
    settings = ServerSettings(data=folder / "data")
    this_python(settings.data)
    store = Store(settings.database_url)
    ego = {"outcome": "arrived", "ds": 20.0, "rc": 20.0, "ip": 1.0, "infractions": [{"kind": "x" * 80}] * 9}
    result = {"ds": 20.0, "sr": 0.0, "egos": [ego | {"id": f"cav-{n}"} for n in range(8)]}
    outcome = JobOutcome(ScenarioVerdict.OK, result)
    click.echo(f"overview: {overviews.count_bytes(overviews.make_overview(result, None))} bytes")
    with store.write() as session:
        made = [teams.create(session, name, now_us()) for name in ("good", "bad")]
        held = {team.name: tokens.issue(session, team, TokenScope.SUBMIT, now_us()) for team in made}
        new = submissions.NewSubmission(
            made[0].id, ChallengeTrack.SINGLE, "m", "a" * 64, 1, "python3.11-numpy", {"version": "1"}
        )
        wanted = [(f"s{n:03}", 0) for n in range(225)]
        mine = submissions.accept(session, new, phases.get(session, "dev"), wanted, now_us()).id
        while (job := jobs.claim(session, "w", LEASE, now_us())) is not None:
            jobs.finish(session, job.id, "w", 1, outcome, now_us() + S)
        submissions.finish_if_complete(session, mine, summary(20.0), now_us())
    store.close()
    return held, mine


def upload(client: httpx.Client, address: str, token: str, data: bytes) -> int:
    """Status of one upload."""
    form = {"phase": "dev", "track": "single-agent", "name": "method"}
    headers = {"Authorization": f"Bearer {token}"}
    files = {"archive": ("team.zip", data, "application/zip")}
    return client.post(f"{address}{API}/submissions", data=form, files=files, headers=headers).status_code


def timed(call: Callable[[], int], expected: int) -> float:
    """Duration of a request [ms]."""
    since = time.perf_counter()
    status = call()
    assert status == expected, status
    return (time.perf_counter() - since) * 1e3


def measure(address: str, token: str, seconds: float, first: int) -> dict[str, list[float]]:
    """Durations [ms] of requests for /health, and of good uploads beside them."""
    end, health, uploads = time.monotonic() + seconds, list[float](), list[float]()

    def send() -> None:
        with httpx.Client(timeout=120) as client:
            number = first
            while time.monotonic() < end:
                data = another_zip(number)
                uploads.append(timed(lambda data=data: upload(client, address, token, data), 201))
                number += 1
                time.sleep(0.5)

    sender = threading.Thread(target=send)
    sender.start()
    with httpx.Client(timeout=120) as client:
        while time.monotonic() < end:
            health.append(timed(lambda: client.get(f"{address}{API}/health").status_code, 200))
            time.sleep(0.1)
    sender.join()
    return {"health": health, "good upload": uploads}


ATTACKER = """
import os, sys, threading, httpx, json
os.nice(40)  # clients have machines of their own: as far as possible they take no time from the server
sys.path[:0] = json.loads(sys.argv[1])
import attacks
address, mine, token, file = sys.argv[2:6]
data = open(file, "rb").read()
counts = open(file + ".counts", "ab", buffering=0)
def read():
    while True:
        httpx.get(f"{address}/api/v1/submissions/{mine}/scenarios", timeout=120).raise_for_status()
        counts.write(b"r")
def send():
    with httpx.Client(timeout=120) as client:
        while True:
            assert attacks.upload(client, address, token, data) == 422
            counts.write(b"u")
for work, count in ((read, attacks.READERS), (send, attacks.UPLOADERS)):
    for _ in range(count):
        threading.Thread(target=work, daemon=True).start()
sys.stdin.read()
"""


@contextmanager
def attack(address: str, mine: str, token: str, folder: Path) -> Iterator[None]:
    """Both attacks, from a process of their own."""
    file = folder / "bad.zip"
    file.write_bytes(broken_at_its_end(48))
    arguments = [json.dumps(PATHS), address, mine, token, str(file)]
    process = subprocess.Popen([sys.executable, "-c", ATTACKER, *arguments], stdin=subprocess.PIPE)
    try:
        while not Path(f"{file}.counts").is_file() or Path(f"{file}.counts").stat().st_size < READERS:
            time.sleep(0.5)
        yield
    finally:
        process.kill()
        process.wait()
        counts = Path(f"{file}.counts").read_bytes()
        click.echo(f"attack: {counts.count(b'r')} lists read, {counts.count(b'u')} archives checked and refused")


def show(name: str, found: dict[str, list[float]]) -> None:
    """Print a row for each kind of request."""
    for what, times in found.items():
        middle = statistics.median(times)
        click.echo(f"{name:9} {what:12} {len(times):4} x  median {middle:7.0f} ms  max {max(times):7.0f} ms")


def main() -> None:
    """Measure and print."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 15.0
    with tempfile.TemporaryDirectory(dir="/dev/shm") as scratch:
        folder = Path(scratch)
        with serving(folder) as address:
            held, mine = prepare(folder)
            show("quiet", measure(address, held["good"], seconds, 0))
            with attack(address, mine, held["bad"], folder):
                show("attacked", measure(address, held["good"], seconds, 10_000))


if __name__ == "__main__":
    main()
