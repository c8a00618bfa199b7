"""Checks of archives under attack: fair turns, a quota of refused uploads, cheap checks first."""

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from testing import archive_samples
from testing.api_app import API, FakeSuites, Server, another_zip, listening, problem
from testing.store_samples import NOON, PHASE

from server.api.app import create_app
from server.api.check_queue import CheckQueue
from server.api.subprocess_runner import CallEndedError, SubprocessPool
from server.archive import verify_contents
from server.clock import DAY_US
from server.settings import ArchiveSettings
from server.store import phases

BROKEN = archive_samples.broken_at_its_end(1)
SMALL_BOMBS = archive_samples.packed(archive_samples.GOOD | {f"src/{n}": bytes(2**20) for n in range(20)})
"""A thousand times as large as they are packed, as those found (254 MiB in 284 kB)."""


class Runner:
    """Runs calls here and keeps the names of their functions."""

    def __init__(self) -> None:
        self.called: list[str] = []

    def call(self, limit_s: float, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        self.called.append(function.__name__)
        if function is verify_contents and limit_s < 1.0:
            raise CallEndedError(503, "busy", "it took longer")  # type: ignore[arg-type]
        return function(*args, **kwargs)

    def close(self) -> None:
        pass


@pytest.fixture
def runner(server: Server) -> Runner:
    found = Runner()
    serve_with(server, found)
    return found


def serve_with(server: Server, runner: Any, **limits: Any) -> None:
    """Give the server another runner and other limits."""
    limits = {"archive_bytes": 16 * 2**20} | limits
    server.settings = server.settings.model_copy(update={"limits": ArchiveSettings(**limits)})
    server.app = create_app(server.settings, server.store, FakeSuites(), runner, lambda: server.now_us)
    server.client.app = server.app  # pyright: ignore[reportAttributeAccessIssue]
    server.client = type(server.client)(server.app)


def test_what_is_cheap_comes_first(server: Server, runner: Runner) -> None:
    """Nothing is unpacked for an archive that its directory, environment or style already refuses."""
    assert len(SMALL_BOMBS) < 20 * 2**20 / 800
    problem(server.send(data=SMALL_BOMBS), 422, "at most 50 times")
    problem(server.send(track="joint"), 422, "for each CAV")
    problem(server.send(data=archive_samples.packed(archive_samples.GOOD | {"model_env.yaml": b"name: x"})), 422, "'x'")
    torch = archive_samples.GOOD | {"model_env.yaml": b"name: python3.11-torch-cpu"}
    problem(server.send(data=archive_samples.packed(torch)), 422, "torch-cpu")
    assert runner.called == ["inspect_archive"] * 4
    problem(server.send(data=BROKEN), 422, "Bad CRC-32")
    assert runner.called[4:] == ["inspect_archive", "verify_contents"]


def test_refused_uploads_have_a_quota_of_their_own(server: Server) -> None:
    runner = Runner()
    serve_with(server, runner, refused_per_day=3)
    for _ in range(3):
        problem(server.send(data=BROKEN), 422)
    found = problem(server.send(), 429, "3 archives", "refused today", "mdrive-sumo check")
    assert found["kind"] == "refused" and found["retry_at"]
    assert len(runner.called) == 6  # refused before anything is examined
    assert server.send("blue").status_code == 201
    server.now_us = NOON + DAY_US
    assert server.send().status_code == 201


def test_a_check_that_takes_too_long_counts_as_refused(server: Server) -> None:
    serve_with(server, Runner(), refused_per_day=1, check_s=0.5)
    problem(server.send(), 422, "checked within 0.5 s")
    problem(server.send(), 429, "refused today")


def test_a_known_archive_is_not_checked_again(server: Server, runner: Runner) -> None:
    first = server.send(key="once").json()["id"]
    runner.called.clear()
    assert server.send(key="once").json()["id"] == first
    assert runner.called == []


class Steps:
    """Teams at a queue, in a clock that tests set."""

    def __init__(self, slots: int) -> None:
        self.now_s = 0.0
        self.queue = CheckQueue(slots, lambda: self.now_s)
        self.order: list[str] = []
        self.ends: dict[str, asyncio.Event] = {}

    async def check(self, name: str) -> None:
        """One check of the team that its name begins with, until its end is set."""
        self.ends[name] = asyncio.Event()
        async with self.queue.turn(name[0]):
            self.order.append(name)
            await self.ends[name].wait()


async def settle() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


def test_one_team_cannot_occupy_all_checkers() -> None:
    async def scene() -> list[list[str]]:
        steps, seen = Steps(2), []
        tasks = [asyncio.create_task(steps.check(name)) for name in ("r1", "r2", "r3", "b1", "b2")]
        await settle()
        seen.append(list(steps.order))
        steps.now_s = 10.0
        steps.ends["r1"].set()
        await settle()
        seen.append(list(steps.order))  # one of red again: blue holds the other
        steps.ends["b1"].set()
        steps.ends["r2"].set()
        await settle()
        seen.append(sorted(steps.order))
        for end in steps.ends.values():
            end.set()
        await asyncio.gather(*tasks)
        return seen

    first, second, third = asyncio.run(scene())
    assert first == ["r1", "b1"]
    assert second == ["r1", "b1", "r2"]
    assert third == ["b1", "b2", "r1", "r2", "r3"]


def test_the_team_with_the_least_checking_time_is_next() -> None:
    async def scene() -> list[str]:
        steps = Steps(3)
        tasks = [asyncio.create_task(steps.check(name)) for name in ("r1", "r2", "g1", "r3", "g2", "b1")]
        await settle()
        assert steps.order == ["r1", "r2", "g1"]
        steps.now_s = 5.0
        steps.ends["r1"].set()
        await settle()
        for name in ("r2", "g1", "b1", "g2", "r3"):
            steps.ends[name].set()
            await settle()
        await asyncio.gather(*tasks)
        return steps.order

    assert asyncio.run(scene()) == ["r1", "r2", "g1", "g2", "b1", "r3"]


def test_clients_that_leave_give_their_turn_back() -> None:
    async def scene() -> list[str]:
        steps = Steps(2)
        tasks = [asyncio.create_task(steps.check(name)) for name in ("r1", "b1", "g1", "y1")]
        await settle()
        tasks[2].cancel()
        steps.ends["r1"].set()
        tasks[3].cancel()
        await settle()
        tasks.append(asyncio.create_task(steps.check("w1")))
        await settle()
        for end in steps.ends.values():
            end.set()
        await asyncio.gather(*tasks, return_exceptions=True)
        return steps.order

    assert asyncio.run(scene()) == ["r1", "b1", "w1"]
    with pytest.raises(ValueError, match="at least 2"):
        CheckQueue(1)


@contextmanager
def attacked(address: str, token: str, data: bytes, at_a_time: int) -> Iterator[list[int]]:
    """Statuses of uploads that one team sends without a pause."""
    statuses: list[int] = []
    stopped = False

    def flood() -> None:
        with httpx.Client(timeout=60) as client:
            while not stopped:
                statuses.append(post(client, address, token, data))

    with ThreadPoolExecutor(at_a_time) as pool:
        floods = [pool.submit(flood) for _ in range(at_a_time)]
        try:
            yield statuses
        finally:
            stopped = True
            for each in floods:
                each.result()


def post(client: httpx.Client, address: str, token: str, data: bytes) -> int:
    form = {"phase": "dev", "track": "single-agent", "name": "method"}
    files = {"archive": ("team.zip", data, "application/zip")}
    headers = {"Authorization": f"Bearer {token}"}
    return client.post(f"{address}{API}/submissions", data=form, files=files, headers=headers).status_code


@pytest.mark.full  # in `make test`: the turns of the queue, step by step, and the quota of refused uploads
def test_honest_uploads_are_accepted_under_attack(tmp_path: Path) -> None:
    """One team sends what takes long and is refused in eight connections; another sends good archives meanwhile."""
    server, pool = Server(tmp_path), SubprocessPool(2)
    serve_with(server, pool, refused_per_day=10_000)
    with server.store.write() as session:
        phases.set_phases(session, [replace(PHASE, per_day=100, in_parallel=100)], NOON)
    long = archive_samples.broken_at_its_end(24)
    honest: list[int] = []
    try:
        pool.start()
        with (
            listening(server) as address,
            httpx.Client(timeout=60) as client,
            attacked(address, server.tokens["red"], long, 8) as bad,
        ):
            honest += [post(client, address, server.tokens["blue"], another_zip(number)) for number in range(6)]
    finally:
        pool.close()
    assert honest == [201] * 6
    assert set(bad) == {422} and len(bad) >= 8
