"""Values that pass between the server and the simulation process of a drive: the setup, facts, events and calls.

Nothing here loads the simulator: the server process imports it, and `server.drive.worker` in a process of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mdrive_sumo.contract import Control
from mdrive_sumo.episode.episode_options import EpisodeOptions
from server.drive.protocol import FrameState
from server.drive.take_tree import TakeTree

TICK_LIMIT_S = 10.0
"""Chosen: 200 ticks late is no loaded machine, and people do not wait longer before they reload the page."""


@dataclass(frozen=True, slots=True)
class DriveSetup:
    """What is driven, which CAVs people drive, and where it is kept."""

    scenario: str
    """Id of the scenario."""
    folder: Path
    """The drive folder: `tree.json` and `takes/`. One that has takes is continued, see `SimulationProcess.open`."""
    people: tuple[str, ...] = ()
    """The CAVs that people drive from the first live tick on."""
    suite: str = ""
    """Name of a packaged suite or a folder; "": the packaged suite that has the scenario."""
    seed: int = 0
    """Seed of the episode: 0 is the scenario as written."""
    others: str = "sharing"
    """The built-in agent of the CAVs that no person drives."""
    substitutes: tuple[str, ...] = ("sharing",)
    """The built-in agents that may take over a CAV or drive a what-if branch, besides `others`."""
    v2x: str = "sharing"
    """What the on-board system of a CAV that a person drives sends: `sharing` (CAM and CPM) or `off`."""
    device: str = "keyboard"
    """PersonInput device, for the provenance of the takes."""
    options: EpisodeOptions = field(default_factory=EpisodeOptions)
    """Conditions of the episode. The agent clock must not be `measured`."""
    from_run: Path | None = None
    """A run folder whose episode of this scenario and seed is entered; its suite, options and agents are used."""
    from_tick: int = 0
    """The tick in which that episode is entered."""
    checkpoint_s: float = 2.0
    """Simulated time between two checkpoints [s]; 0: none."""
    speed_up: float = 1.0
    """How many times faster than real time the clock runs at most: for drivers that are programs. People have 1."""
    tick_limit_s: float = TICK_LIMIT_S
    """Time without a tick while the clock runs [s] after which the process of the live take is ended: it hangs."""
    weather: str = ""
    """Weather of the scene that is shown; "": that of the scenario. It changes no simulation."""


@dataclass(frozen=True, slots=True)
class DriveFacts:
    """What does not change during a drive. Arrays as plain lists, positions in the world frame [m]."""

    scenario: str
    description: str
    """What the scenario tests."""
    suite: str
    seed: int
    cavs: tuple[str, ...]
    """Ids of all CAVs, in the order of the scenario file."""
    people: tuple[str, ...]
    """The CAVs that people drive."""
    origin: tuple[float, float]
    """The point [m] to which positions in frames, motions and the scene are relative."""
    routes: Mapping[str, list[tuple[float, float]]]
    """Points every metre [m], relative to the origin, by CAV."""
    speed_limits: Mapping[str, list[float]]
    """Speed limit [m/s] at each point of the route, by CAV."""
    room: Mapping[str, list[float]]
    """Width of the lane [m] at each point of the route, by CAV."""
    vehicle: Mapping[str, float]
    """All `VehicleParameters` of the CAVs, with the grip of this road: what a prediction needs."""
    time_limit_ticks: Mapping[str, int]
    """Tick in which each CAV is timed out."""
    agents: tuple[str, ...]
    """Built-in agents that may take over."""
    weather: str
    """Name of the weather of the scene."""
    pseudonyms: Mapping[str, str]
    """Id in V2X messages of every CAV and road-side unit, by id in the scenario."""
    tick_s: float = 0.05


# ------------------------------------------------------------------------------------------------------------- events


@dataclass(frozen=True, slots=True)
class DriveFrame:
    """One tick of the live take."""

    take: int
    tick: int
    state: FrameState
    acks: Mapping[str, int]
    """Number of the input that the last tick used, by CAV of a person; 0: none."""
    own: Mapping[str, tuple[float, ...]]
    """`VehicleState` (x, y, yaw, vx, vy, yaw_rate, steer_angle, drive, brake, acceleration) of each CAV in the world,
    by id; world frame."""
    rows: bytes
    """Road users as an array of `protocol.ROW`."""
    extra: Mapping[str, Any]
    """What is new in this frame, ready for JSON; everything in the first frame of a take: `names` [[index, id, kind,
    length, width, height, model, [r, g, b]]], `signals` {light: letters}, `messages` [{from, to, kind, at, ...}],
    `collisions` [{cav, with, id}] that begin, `endings` {cav: word}, `drivers` {cav: driver}, `factor` (simulated by
    real time, about every second). `to` is the list of the CAVs that received the message in this tick."""


@dataclass(frozen=True, slots=True)
class TakeStarted:
    """A take is live, paused in `tick`; its frames follow."""

    take: int
    parent: int | None
    tick: int
    drivers: Mapping[str, str]
    """Driver by CAV."""


@dataclass(frozen=True, slots=True)
class TakeEnded:
    """A take is finished, scored and stored: the live one, or in the background one that was left."""

    take: int
    tick: int
    """Its last tick."""
    score: float
    """Driving score, mean of the CAVs, 0 to 100."""
    ds: Mapping[str, float]
    """Driving score by CAV."""
    is_left: bool
    """Whether its people left it before its end."""


@dataclass(frozen=True, slots=True)
class HandedOver:
    """A CAV has another driver from `tick` on."""

    take: int
    tick: int
    cav: str
    driver: str


@dataclass(frozen=True, slots=True)
class Behind:
    """The simulation is slower than real time, or no longer so: simulated time by real time in the last seconds."""

    take: int
    factor: float


@dataclass(frozen=True, slots=True)
class TreeChanged:
    """The takes of the drive."""

    tree: TakeTree


@dataclass(frozen=True, slots=True)
class DriveProblem:
    """Something went wrong; the drive is paused if it concerns the live take. One sentence for the person."""

    text: str
    is_fatal: bool = False
    """Whether the simulation process has ended: `open` with the same folder continues the drive."""


Event = DriveFrame | TakeStarted | TakeEnded | HandedOver | Behind | TreeChanged | DriveProblem


@dataclass(frozen=True, slots=True)
class WhatIfBranch:
    """A what-if branch: what an agent would have done from a tick on."""

    agent: str
    take: int
    tick: int
    """The first tick of the tracks."""
    tracks: Mapping[str, Sequence[tuple[float, float, float, float]]]
    """x, y [m, relative to the origin], yaw [rad], speed [m/s] in each tick, by CAV."""
    endings: Mapping[str, str]
    """How CAVs ended, by CAV."""
    contacts: Sequence[tuple[int, str, str]]
    """(tick, CAV, what it touched)."""


# --------------------------------------------------------------------------------- between server and supervisor only


@dataclass(frozen=True, slots=True)
class DriveCall:
    """A call of the server; the supervisor answers with an `CallAnswer` of the same number."""

    number: int
    name: str
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class CallAnswer:
    """The result of a call, or the sentence why there is none."""

    number: int
    value: Any = None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class PersonInput:
    """One numbered input of a person; it has no answer."""

    cav: str
    number: int
    control: Control
