"""What is true at one tick. Time is an integer; a Frame is a fact and never changes."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum, auto

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Float

TICKS_PER_SECOND = 20
DT = 1 / TICKS_PER_SECOND
"""Length of a tick [s]: 20 Hz (paper, Simulation Setting)."""
HELD_TICKS = 2 * TICKS_PER_SECOND
"""How long a road user that a CAV struck stands, scripted or driven by SUMO: a surrogate, neither knows an impact."""


class Kind(IntEnum):
    """What a road user or obstacle is; the value is what recordings store."""

    VEHICLE = 0
    PEDESTRIAN = 1
    CYCLIST = 2
    STATIC = 3


class End(StrEnum):
    """How an ego ended (protocol 5.2)."""

    ARRIVED = auto()
    BLOCKED = auto()
    DEVIATED = auto()
    TIMED_OUT = "timed-out"
    AGENT_FAILED = "agent-failed"


class Failure(StrEnum):
    """Why an agent failed; the reason of `End.AGENT_FAILED`."""

    CRASHED = auto()
    TIMEOUT = auto()
    INVALID = auto()


@dataclass(frozen=True, slots=True)
class EgoState:
    """One CAV: box centre in the world frame [m], yaw [rad], speed along yaw [m/s], and its own instruments."""

    x: float
    y: float
    yaw: float
    speed: float
    acceleration: float = 0.0
    """Along yaw [m/s2]."""
    yaw_rate: float = 0.0
    """[rad/s]"""
    steer_angle: float = 0.0
    """Angle of the front wheels [rad], left positive."""


@dataclass(frozen=True, slots=True)
class Actors:
    """Everything but the CAVs and the road, present in this tick. Struct of arrays, all (N,), sorted by id."""

    ids: tuple[str, ...]
    kind: npt.NDArray[np.uint8]
    x: Float
    y: Float
    yaw: Float
    speed: Float
    length: Float
    width: Float

    def __len__(self) -> int:
        return len(self.ids)


def no_actors() -> Actors:
    """Actors of an empty road."""
    empty = np.zeros(0)
    return Actors((), np.zeros(0, dtype=np.uint8), empty, empty, empty, empty, empty, empty)


@dataclass(frozen=True, slots=True)
class WorldState:
    """What the simulator drives in one tick: background vehicles, and the states of traffic lights by id."""

    actors: Actors
    signals: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Contact:
    """An ego's box met something in this tick. `other` is an ego id, an actor id, or "" for the map (a building)."""

    ego: str
    other: str
    kind: Kind


@dataclass(frozen=True, slots=True)
class Frame:
    """The world at one tick: living CAVs by id, other actors, states of traffic lights (SUMO letters), contacts."""

    tick: int
    egos: Mapping[str, EgoState]
    actors: Actors
    signals: Mapping[str, str]
    contacts: tuple[Contact, ...] = ()
