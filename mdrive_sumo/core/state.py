"""State of the world at one tick. Time is an integer; a Frame is immutable."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum, StrEnum, auto
from functools import cache, lru_cache
from itertools import chain
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Float

TICKS_PER_SECOND = 20
DT = 1 / TICKS_PER_SECOND
"""Length of a tick [s]: 20 Hz (paper, Simulation Setting)."""
STRUCK_HOLD_TICKS = 2 * TICKS_PER_SECOND
"""Hold time after a CAV strikes a scripted or SUMO vehicle: a surrogate, because neither models an impact."""

MOTION_AND_SIZE = ("x", "y", "yaw", "speed", "length", "width")
"""Columns of `RoadUsers` that hold floats, in the order of its fields."""


Columns = tuple[npt.NDArray[Any], ...]
"""The columns of `RoadUsers`: `kind`, and those of `MOTION_AND_SIZE`."""


class Kind(IntEnum):
    """Kind of road user or obstacle; recordings store the value."""

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


class FailureReason(StrEnum):
    """Why an agent failed; the reason of `End.AGENT_FAILED`."""

    CRASHED = auto()
    TIMEOUT = auto()
    INVALID = auto()
    LEFT = auto()
    """The person who drove has left: see `loop.human_driver`."""


@dataclass(frozen=True, slots=True)
class EgoState:
    """State of one CAV: box centre in the world frame [m], yaw [rad], speed along yaw [m/s], on-board measurements."""

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
class RoadUsers:
    """Oriented boxes of road users and obstacles as a struct of arrays; every array has one row (N,) per box."""

    ids: tuple[str, ...]
    """Name of each box."""
    kind: npt.NDArray[np.uint8]
    """Values of `Kind`."""
    x: Float
    """World frame, box centre [m]."""
    y: Float
    """World frame, box centre [m]."""
    yaw: Float
    """Heading [rad], counter-clockwise from +x."""
    speed: Float
    """Along yaw [m/s]."""
    length: Float
    """[m]"""
    width: Float
    """[m]"""

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def empty(cls) -> Self:
        """Return an instance without rows."""
        return cls((), np.zeros(0, dtype=np.uint8), *(np.zeros(0) for _ in MOTION_AND_SIZE))

    @classmethod
    def from_egos(cls, egos: Mapping[str, EgoState], dimensions: Mapping[str, tuple[float, float]]) -> Self:
        """Return one row per CAV in the order of `egos`; dimensions: (length, width) [m] by CAV id."""
        return cls(tuple(egos), *build_ego_columns(list(egos.values()), [dimensions[name] for name in egos]))

    def concat(self, *others: "RoadUsers") -> Self:
        """Return the own rows followed by those of the others; every field that is not per row stays the own one."""
        parts: list[RoadUsers] = [self, *(other for other in others if other.ids)]
        if len(parts) == 1:
            return self
        ids = tuple(chain.from_iterable(part.ids for part in parts))
        return build_frozen(type(self), ids, *join_columns(parts), *self._get_rest())

    def take(self, rows: npt.NDArray[np.intp] | npt.NDArray[np.bool_] | slice) -> Self:
        """Return the given rows only: indices (M,), a mask (N,) or a slice."""
        if isinstance(rows, slice):
            columns = [getattr(self, name)[rows] for name in ("kind", *MOTION_AND_SIZE)]
            return type(self)(self.ids[rows], *columns, *self._get_rest())
        chosen = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows.astype(np.intp, copy=False)
        ids = tuple(map(self.ids.__getitem__, chosen.tolist()))
        return build_frozen(type(self), ids, *select_columns([self], chosen), *self._get_rest())

    def _get_rest(self) -> list[Any]:
        """Return the values of the fields that are not per row: `dataclasses.replace` is slow, and this runs often."""
        return [getattr(self, name) for name in _list_rest(type(self))]

    def advance(self, seconds: Float | float, turn: Float | float = 0.0) -> Self:
        """Return the boxes after `seconds` at constant speed, on arcs over which the yaw changes by `turn` [rad].

        seconds, turn: (N,) or one number for all rows.
        """
        chord = self.speed * seconds * portable.sinc(np.asarray(turn) / 2 / np.pi)
        direction = self.yaw + np.asarray(turn) / 2
        cos, sin = portable.cos_sin(direction)
        motion = self.x + chord * cos, self.y + chord * sin, self.yaw + turn, self.speed
        return build_frozen(type(self), self.ids, self.kind, *motion, self.length, self.width, *self._get_rest())


@twin
def build_ego_columns(egos: list[EgoState], sizes: list[tuple[float, float]], /) -> Columns:
    """Return the columns of CAVs of these lengths and widths [m]."""
    rows = [(ego.x, ego.y, ego.yaw, ego.speed, *size) for ego, size in zip(egos, sizes, strict=True)]
    columns = np.array(rows, dtype=np.float64).reshape(-1, len(MOTION_AND_SIZE)).T.copy()
    return (np.full(len(rows), Kind.VEHICLE, dtype=np.uint8), *columns)


@twin
def join_columns(parts: list[RoadUsers], /) -> Columns:
    """Return the columns with the rows of all parts, of at least one."""
    return tuple([np.concatenate([getattr(part, name) for part in parts]) for name in ("kind", *MOTION_AND_SIZE)])


@twin
def select_columns(parts: list[RoadUsers], rows: npt.NDArray[np.intp], /) -> Columns:
    """Return the given rows (M,) of the joined columns of one or two parts."""
    return tuple([column[rows] for column in join_columns(parts)])


@cache
def _list_rest(cls: type[RoadUsers]) -> tuple[str, ...]:
    """Return the fields that a class adds, in the order of its constructor."""
    return tuple(field.name for field in fields(cls))[2 + len(MOTION_AND_SIZE) :]


@dataclass(frozen=True, slots=True)
class Actors(RoadUsers):
    """All road users and obstacles of one tick except the CAVs, sorted by id."""

    def merge(self, other: "Actors") -> "Actors":
        """Return the rows of both, sorted by id; the two must not share an id.

        `ids` of the result is the same object in every tick with the same actors, so that callers can cache by it.
        """
        if not other.ids:
            return self
        if not self.ids:
            return other
        ids, order = _sorted_ids(self.ids, other.ids)
        return build_frozen(Actors, ids, *select_columns([self, other], order))


@lru_cache(maxsize=16)
def _sorted_ids(first: tuple[str, ...], second: tuple[str, ...]) -> tuple[tuple[str, ...], npt.NDArray[np.intp]]:
    """Return the ids of both in order, and the row of each in the concatenation."""
    ids = first + second
    order = sorted(range(len(ids)), key=ids.__getitem__)
    return tuple(ids[row] for row in order), np.array(order, dtype=np.intp)


@dataclass(frozen=True, slots=True)
class WorldState:
    """What the simulator drives in one tick: background vehicles, and the states of traffic lights by id."""

    actors: Actors
    signals: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Contact:
    """Contact of an ego's box in this tick. `other` is an ego id, an actor id, or "" for the map (a building)."""

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
