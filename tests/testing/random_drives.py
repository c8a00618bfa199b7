"""A drive of random actions: driving, pauses, rewinds, hand-overs, texts, looks ahead, and kills. No tests in here."""

import asyncio
import os
import random
import signal
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.episode_job import make_reexecution, reexecute
from mdrive_sumo.runs.stored_run import load_stored_run
from server.drive.simulation_process import DriveSetup, TakeEnded, TakeStatus
from server.drive.take_tree import TakeTree, load_tree
from server.drive.worker.take_journal import read_journal
from testing.drives import DriveSession
from testing.takes import load_recorded

WEIGHTS = {"drive": 40, "rewind": 30, "hand over": 15, "say": 5, "pause": 5, "look ahead": 2, "kill": 3}


@dataclass
class RandomDrive:
    """Does `count` actions, chosen by `seed`, in the folder of the setup."""

    setup: DriveSetup
    count: int
    seed: int = 0
    done: Counter[str] = field(default_factory=Counter[str])
    lost: list[str] = field(default_factory=list[str])
    """Actions that a kill has lost, of which there must be none."""
    driven: set[int] = field(default_factory=set[int])
    """The takes with a tick of their own."""

    def run(self) -> None:
        asyncio.run(self._run())

    async def _run(self) -> None:
        self._random = random.Random(self.seed)
        session = await self._open()
        names = self._random.choices(list(WEIGHTS), list(WEIGHTS.values()), k=self.count)
        try:
            for name in names:
                self.done[name] += 1
                if name == "kill":
                    session = await self._kill(session)
                else:
                    await getattr(self, f"_{name.replace(' ', '_')}")(session)
            assert session.problems == []
            await session.close(600.0)
        finally:
            await session.close(0.0)

    async def _open(self) -> DriveSession:
        session = DriveSession(self._press)
        await session.open(self.setup)
        return session

    def _press(self, tick: int) -> Control:
        return Control(round(self._random.random(), 4), 0.0, round(self._random.uniform(-0.05, 0.05), 4))

    async def _drive(self, session: DriveSession) -> None:
        if self._is_over(session):
            await self._rewind(session)
        self.driven.add(max(session.process.tree.takes))
        await session.drive_to(session.tick + self._random.randint(2, 25))

    def _is_over(self, session: DriveSession) -> bool:
        return max(session.process.tree.takes) in {event.take for event in session.select(TakeEnded)}

    async def _rewind(self, session: DriveSession) -> None:
        while True:
            numbers = sorted(session.process.tree.takes)
            take = self._random.choice(numbers[-10:] if self._random.random() < 0.8 else numbers)
            try:
                _, ticks = read_journal(self.setup.folder / "takes" / f"{take}.actions.jsonl")
                left = next((tick + 1 for tick, one in enumerate(ticks) if one.left), len(ticks))
                tick = self._random.randrange(max(1, min(left, len(ticks))))
                number = await session.process.branch(take, tick)
                break
            except InputError as error:  # it was not driven, and has just been dropped
                assert "No such file" in str(error) or "expected one of this drive" in str(error)
                await asyncio.sleep(0.01)
        await session.wait_for(lambda: session.frames[-1].take == number)
        assert session.tick == tick

    async def _hand_over(self, session: DriveSession) -> None:
        cav = self._random.choice(session.process.facts.cavs)
        driver = self._random.choice(("human", *session.process.facts.agents))
        try:
            await session.process.hand_over(cav, driver)
        except InputError as error:  # it has ended, or the take has
            assert "ended" in str(error) or "go back to a tick" in str(error)

    async def _say(self, session: DriveSession) -> None:
        try:
            await session.process.say(session.process.facts.cavs[0], f"text {self._random.random()}")
        except InputError as error:
            assert "ended" in str(error) or "go back to a tick" in str(error) or "at most 8" in str(error)

    async def _pause(self, session: DriveSession) -> None:
        if not self._is_over(session):
            await session.process.resume()
            await session.process.pause()
            await session.process.pause()

    async def _look_ahead(self, session: DriveSession) -> None:
        take = max(session.process.tree.takes)
        _, ticks = read_journal(self.setup.folder / "takes" / f"{take}.actions.jsonl")
        if ticks:
            agents = list(session.process.facts.agents[:1])
            (branch,) = await session.process.what_if(take, self._random.randrange(len(ticks)), agents, 0.5)
            assert branch.tracks

    async def _kill(self, session: DriveSession) -> DriveSession:
        """Kill the supervisor or everything, while the clock runs; every tick that was shown must be in the journal."""
        if not self._is_over(session):
            await session.process.resume()
            await asyncio.sleep(self._random.uniform(0.0, 0.05))
        take, tick = session.frames[-1].take, session.tick
        kill = os.kill if self._random.random() < 0.5 else os.killpg
        kill(session.group, signal.SIGKILL)
        await session.wait_for(lambda: session.problems)
        await session.close(0.0)
        _, ticks = read_journal(self.setup.folder / "takes" / f"{take}.actions.jsonl")
        if len(ticks) < tick - 1:  # the last frame of a take that is done is after its last action
            self.lost.append(f"take {take}: {len(ticks)} of {tick} ticks")
        return await self._open()


def check_takes(folder: Path) -> TakeTree:
    """Check that every take of a drive is finished, equals its parent up to its tick, and can be driven again."""
    tree = load_tree(folder)
    digests: dict[int, np.ndarray] = {}  # pyright: ignore[reportMissingTypeArgument]
    for number, take in tree.takes.items():
        assert take.status is TakeStatus.FINISHED, take
        record = load_recorded(tree.find_folder(number))
        digests[number] = record.digests
        if take.parent is not None:
            assert (record.digests[: take.tick] == digests[take.parent][: take.tick]).all(), take
        stored = load_stored_run(tree.find_folder(number))
        job = stored.run.make_job(stored.run.scenarios[0])
        again = reexecute(make_reexecution(job, record))
        assert again.digest == record.digest == stored.results.scenarios[0].digest, take
        assert (again.digests == record.digests).all()
    return tree
