"""A real `mdrive-sumo serve` with short scenarios, as its teams and visitors see it."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from typing import Any

import httpx
from hostile.teams import MARKER

from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from server.enums import MIN_HIDDEN_SCENARIOS, TokenScope
from server.store import Store, teams, tokens
from testing.small_environment import describe_small_environment

PATIENCE_S = 600.0
"""For everything together; it takes a tenth of it."""
SETTINGS = """\
port = 0
[limits]
archive_bytes = 2097152
unpacked_bytes = 8388608
entries = 50
ratio = 100
refused_per_day = 1000
start_agents = false
[sandbox]
backend = "bubblewrap"
hidden_on_shared_kernel = true
tick_s = 4.0
processes = 24
file_bytes = 2097152
tmp_bytes = 8388608
[work]
processes = 2
spot_check = 0.0
drop_caches = false
"""
PHASE = """\
[[phases]]
id = "{id}"
title = "{id}"
suite = "{suite}"
public = {public}
seeds = {seeds}
opens = 2026-01-01T00:00:00Z
closes = 2099-02-01T00:00:00Z
per_day = 1000
in_parallel = 1000
"""


@dataclass
class Door:
    """A server that runs, as its teams see it."""

    data: Path
    scratch: Path
    """Its temporary folder."""
    address: str
    process: subprocess.Popen[bytes]
    tokens: Mapping[str, str]
    sent: dict[str, str] = field(default_factory=dict[str, str])
    """Names of what was submitted -> ids."""

    def __post_init__(self) -> None:
        self.http = httpx.Client(base_url=f"{self.address}/api/v1", timeout=60.0)

    def ask(self, path: str, who: str = "", method: str = "GET", **more: Any) -> httpx.Response:
        """One request, by the holder of a token."""
        headers = {"Authorization": f"Bearer {self.tokens[who]}"} if who else {}
        return self.http.request(method, path, headers=headers, **more)

    def send(self, name: str, data: bytes, phase: str = "once", who: str = "") -> httpx.Response:
        """An upload; teams take turns."""
        who = who or ("red", "blue")[len(self.sent) % 2]
        form = {"phase": phase, "track": "joint" if name.startswith("joint") else "single-agent", "name": name}
        answer = self.ask("/submissions", who, "POST", data=form, files={"archive": ("team.zip", data)})
        if answer.status_code == 201:
            self.sent[name] = answer.json()["id"]
        return answer

    def finished(self) -> dict[str, Mapping[str, Any]]:
        """All submissions by name, when nothing is left to do."""
        end_s, found = time.monotonic() + PATIENCE_S, dict[str, Mapping[str, Any]]()
        while len(found) < len(self.sent):
            name = next(name for name in self.sent if name not in found)  # they are driven in this order
            each = self.ask(f"/submissions/{self.sent[name]}", "admin").json()
            if each["state"] not in ("queued", "running"):
                found[name] = each
                continue
            assert time.monotonic() < end_s and self.process.poll() is None, f"{name} is not finished"
            time.sleep(0.5)
        return found

    def runs(self, name: str) -> Sequence[Mapping[str, Any]]:
        """The scenarios of a submission."""
        return self.ask(f"/submissions/{self.sent[name]}/scenarios", "admin").json()["items"]

    def log(self, name: str, seed: int = 0) -> str:
        """What its agent wrote."""
        answer = self.ask(f"/submissions/{self.sent[name]}/scenarios/short/{seed}/logs/0", "admin")
        assert answer.status_code == 200, answer.text
        return answer.text

    def admin(self, *words: str) -> subprocess.CompletedProcess[str]:
        """`mdrive-sumo admin`."""
        return subprocess.run(
            [*command("admin", self.data.parent), *words], capture_output=True, text=True, check=False, timeout=120
        )


class Watch:
    """Asks for health and a leaderboard five times a second, as a visitor would, and notes how it goes."""

    def __init__(self, door: Door) -> None:
        self._door, self._over = door, Event()
        self._thread = Thread(target=self._look, name="visitor")
        self.seconds: list[float] = []
        self.failures: list[str] = []

    def __enter__(self) -> "Watch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def told(self) -> str:
        """Figures of all answers."""
        ranked = sorted(self.seconds)
        p50, p99 = (ranked[len(ranked) * share // 100] * 1000 for share in (50, 99))
        return f"{len(ranked)} answers, p50 {p50:.0f} ms, p99 {p99:.0f} ms, failures {self.failures}"

    def _look(self) -> None:
        with httpx.Client(base_url=f"{self._door.address}/api/v1", timeout=20.0) as http:
            while not self._over.wait(0.2):
                for path in ("/health", "/leaderboards/once"):
                    began_s = time.monotonic()
                    try:
                        answer = http.get(path)
                    except httpx.HTTPError as error:
                        self.failures.append(f"{path}: {error!r}")
                        continue
                    self.seconds.append(time.monotonic() - began_s)
                    if answer.status_code != 200:
                        self.failures.append(f"{path}: {answer.status_code} {answer.text}")


def told(log: str) -> dict[str, Any]:
    """What a program found, by its log."""
    facts: dict[str, Any] = {}
    for line in log.splitlines():
        if line.startswith("TOLD "):
            facts |= json.loads(line.removeprefix("TOLD "))
    return facts


def command(name: str, folder: Path) -> list[str]:
    """`mdrive-sumo serve` or `admin` on what `prepared` has written."""
    start = f"from server.cli import {name}; {name}()"
    return [sys.executable, "-c", start, "--settings", str(folder / "server.toml"), "--data", str(folder / "data")]


def prepared(folder: Path) -> Path:
    """Suites, settings and an environment; returns the data folder."""
    phases = [("once", "public", 1), ("twice", "public", 2), ("secret", MARKER, 1)]
    _write_suite(folder / "public", 1, "short")
    _write_suite(folder / MARKER, 0, MARKER, *(f"{MARKER}-{number}" for number in range(1, MIN_HIDDEN_SCENARIOS)))
    texts = [
        PHASE.format(id=id_, suite=folder / suite, public=str(suite == "public").lower(), seeds=seeds)
        for id_, suite, seeds in phases
    ]
    (folder / "server.toml").write_text(SETTINGS + "".join(texts))
    about = folder / "data" / "environments" / "python3.11-numpy"
    about.mkdir(parents=True)
    describe_small_environment(about)
    return folder / "data"


def _write_suite(folder: Path, cav: int, *ids: str) -> None:
    """Scenarios of one CAV that goes some ten metres, alike but for their ids."""
    long = next(each for each in load_suite("interdrive@0").scenarios if each.id == "i07_ins_ss_town")
    ego = long.egos[cav].model_copy(update={"id": "0", "route": long.egos[cav].route[:14]})
    short = tuple(long.model_copy(update={"id": each, "egos": (ego,)}) for each in ids)
    save_suite(Suite(SuiteFile(name="short", title="Short"), folder, short))


@contextmanager
def serving(folder: Path) -> Generator[Door]:
    """Starts it, with its own temporary folder, and ends it as an operator does."""
    data, scratch = prepared(folder), folder / "scratch"
    scratch.mkdir()
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            command("serve", folder), stdout=log, stderr=subprocess.STDOUT, env={**os.environ, "TMPDIR": str(scratch)}
        )
    try:
        end_s = time.monotonic() + 120.0
        while "running on http://" not in (text := (folder / "log").read_text()):
            assert process.poll() is None and time.monotonic() < end_s, text
            time.sleep(0.1)
        door = Door(data, scratch, text.split("running on ")[1].split()[0], process, _tokens(data))
        with door.http:
            yield door
        process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0, (folder / "log").read_text()
    finally:
        process.kill()
        process.wait()


def _tokens(data: Path) -> dict[str, str]:
    store, now_us = Store(f"sqlite:///{data / 'challenge.sqlite'}"), time.time_ns() // 1000
    with store.write() as session:
        issued = {
            name: tokens.issue(session, teams.create(session, name, now_us), TokenScope.SUBMIT, now_us)
            for name in ("red", "blue", "spy", "honest")
        }
        issued["admin"] = tokens.issue(session, None, TokenScope.ADMIN, now_us)
    store.close()
    return issued
