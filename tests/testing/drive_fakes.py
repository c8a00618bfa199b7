"""A simulation process of `drive` that is none: it answers at once, and tests say what happens. No tests in here."""

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from server.drive.protocol import ROW, FrameState
from server.drive.simulation_process import SimulationProcess
from server.drive.simulation_values import (
    DriveFacts,
    DriveFrame,
    DriveProblem,
    DriveSetup,
    Event,
    HandedOver,
    TakeStarted,
    TreeChanged,
    WhatIfBranch,
)
from server.drive.take_tree import Take, TakeTree

CAVS = ("ego_0", "ego_1", "ego_2")
CAR = ("vehicle", 4.9, 2.0, 1.5, "car", [1, 2, 3])
NAMES = [[0, "ego_0", *CAR], [1, "bg", *CAR]]


def make_setup(folder: Path, people: Sequence[str] = ("ego_0",)) -> DriveSetup:
    return DriveSetup("i11_ins_sl_town", folder, tuple(people))


class FakeSimulation(SimulationProcess):
    """Counts its calls; `emit` lets something happen."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple[Any, ...]] = []
        self.inputs: list[tuple[str, int, Control]] = []
        self.fake_tree = TakeTree(Path(), {})
        self.take, self.tick = 1, 0
        self.refusal = ""

    async def open(self, setup: DriveSetup) -> None:
        if setup.scenario == "unknown":
            raise InputError("scenario 'unknown': expected the id of a scenario in a packaged suite, found none")
        route = [(0.0, float(i)) for i in range(3)]
        self._facts = DriveFacts(
            scenario=setup.scenario,
            description="A crossing.",
            suite="interdrive",
            seed=setup.seed,
            cavs=CAVS,
            people=setup.people,
            origin=(100.0, 50.0),
            routes=dict.fromkeys(CAVS, route),
            speed_limits=dict.fromkeys(CAVS, [13.9] * 3),
            room=dict.fromkeys(CAVS, [3.2] * 3),
            vehicle={"length": 4.9, "width": 2.0},
            time_limit_ticks=dict.fromkeys(CAVS, 1200),
            agents=("sharing", "idm"),
            weather="clear_day",
            pseudonyms={cav: f"p{cav}" for cav in CAVS},
        )
        self._scene = b"scene"
        self.fake_tree = TakeTree(setup.folder, {"scenario": setup.scenario})
        drivers = {cav: "human" if cav in setup.people else setup.others for cav in CAVS}
        self._begin(None, drivers)

    def _begin(self, parent: int | None, drivers: Mapping[str, str]) -> None:
        self.fake_tree = self.fake_tree.with_take(Take(self.take, parent, self.tick, drivers))
        self._tree = self.fake_tree
        self.emit(TreeChanged(self.fake_tree), TakeStarted(self.take, parent, self.tick, drivers))
        self.emit_frame(FrameState.PAUSED, names=NAMES, signals={"J": "rG"}, drivers=dict(drivers))

    def emit(self, *events: Event) -> None:
        for event in events:
            if isinstance(event, DriveFrame):
                self._known.add(event)
            self._events.put_nowait(event)

    def emit_frame(self, state: FrameState = FrameState.RUNNING, **extra: Any) -> None:
        rows = np.zeros(2, ROW)
        rows["name"] = (0, 1)
        acks = {cav: max((number for one, number, _ in self.inputs if one == cav), default=0) for cav in CAVS}
        own = {cav: (float(i),) * 10 for i, cav in enumerate(CAVS)}
        self.emit(DriveFrame(self.take, self.tick, state, acks, own, rows.tobytes(), extra))

    def step(self, **extra: Any) -> None:
        self.tick += 1
        self.emit_frame(**extra)

    def end(self) -> None:
        self.emit(DriveProblem("the simulation of this drive has ended", is_fatal=True))
        self._events.put_nowait(None)

    async def events(self) -> AsyncIterator[Event]:
        while (event := await self._events.get()) is not None:
            yield event

    def put_input(self, cav: str, number: int, control: Control) -> None:
        self.inputs.append((cav, number, control))

    def _note(self, *call: Any) -> None:
        self.calls.append(call)
        if self.refusal:
            raise InputError(self.refusal)

    async def pause(self) -> None:
        self._note("pause")
        self.emit_frame(FrameState.PAUSED)

    async def resume(self) -> None:
        self._note("resume")
        self.emit_frame(FrameState.RUNNING)

    async def branch(self, take: int, tick: int) -> int:
        self._note("branch", take, tick)
        drivers = self.fake_tree.find(take).drivers
        self.take, self.tick = self.fake_tree.next_number, tick
        self._begin(take, drivers)
        return self.take

    async def hand_over(self, cav: str, driver: str, config: Mapping[str, Any] | None = None) -> None:
        self._note("hand_over", cav, driver, dict(config or {}))
        self.emit(HandedOver(self.take, self.tick, cav, driver))

    async def say(self, cav: str, text: str) -> None:
        self._note("say", cav, text)

    async def what_if(
        self, take: int, tick: int, agents: Sequence[str], seconds: float = 5.0, cavs: Sequence[str] = ()
    ) -> list[WhatIfBranch]:
        self._note("what_if", take, tick, tuple(agents), seconds, tuple(cavs))
        await asyncio.sleep(0)
        tracks = {"ego_0": [(1.0, 2.0, 0.5, 3.0)]}
        return [WhatIfBranch(agent, take, tick, tracks, {"ego_0": "arrived"}, []) for agent in agents]

    async def load_motion(self, take: int) -> bytes:
        self.fake_tree.find(take)
        return b"motion"

    async def leave(self) -> None:
        self._note("leave")

    async def note_input(self, device: str, latency_ms: float) -> None:
        self._note("note_input", device, latency_ms)

    async def close(self, wait_s: float = 120.0) -> None:
        self.calls.append(("close", wait_s))
        self._events.put_nowait(None)
