"""Whom a lone driver must mind: what is on its way, and who will cross its way first.

Nothing is known of the others but what is seen: they are expected to go on at their speed, turning as they do now.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from mdrive_sumo.contract import Objects, VehicleFacts
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, wrap_angle
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.path import Path
from mdrive_sumo.planning.path_overlap import cells_of, footprints, overlaps

LOOK_M = 40.0
"""How far ahead a driver looks, on its own path and on the others' ways."""
STRIDE_M = 1.0
SIDE_M = 0.25
"""Kept free on either side."""
MOVING_SPEED = 0.5
"""[m/s] Who is slower stands, and is taken to come at this speed: later than anybody who drives."""
GAP_S = 1.0
"""Two cars that use the same place less than this apart are in conflict."""
TIE_S = 0.5
"""Arrivals that differ by less are a tie."""
HOLD_S = 1.5
"""Who gives way does not change its mind until the other one would be so much later."""
SAME_WAY = math.radians(60)
LEVEL_M = 0.5
"""Cars whose middles are less apart along the road are level."""
SHARPEST = 0.15
"""[1/m] Nobody is expected to turn more sharply than this."""
SIDE_ANGLES = (math.radians(20), math.radians(160))
"""Who drives at such an angle to me comes from the side."""


Place: TypeAlias = tuple[float, float]
"""Nobody knows the others' names, but all see the same places: where two are equal in all else, the one further west
goes first (of those the one further south), and both know it."""


@dataclass(frozen=True, slots=True)
class Mover:
    """The own car: its place [m] and speed [m/s], and how it will speed up [m/s2] to its cruising speed."""

    place: Place
    speed: float
    cruise: float
    acceleration: float

    def time_to(self, distance: float) -> float:
        """How long it takes [s] for that distance [m]."""
        cruise = max(self.cruise, self.speed, 0.1)
        ramp = (cruise - self.speed) / self.acceleration
        ramp_m = (cruise + self.speed) / 2 * ramp
        if distance >= ramp_m:
            return ramp + (distance - ramp_m) / cruise
        return (math.sqrt(self.speed**2 + 2 * self.acceleration * distance) - self.speed) / self.acceleration


@dataclass(frozen=True, slots=True)
class Outlook:
    """The next `LOOK_M` of the own path at stations (A,): distance [m], direction [rad], footprints (A, 4, 2)."""

    distance: Float
    yaw: Float
    boxes: Float


@dataclass(frozen=True, slots=True)
class Leader:
    """Something on the way: how far the own car can go [m] until it touches it, and its speed along the path [m/s]."""

    gap: float
    speed: float


@dataclass(frozen=True, slots=True)
class Crossing:
    """Somebody whose way crosses mine."""

    id: str
    first: float
    """Where the common place begins and ends on my path [m from here]."""
    last: float
    arrives_s: float
    """When the other one is there, from and until."""
    leaves_s: float
    standing: bool
    bearing: float
    """Direction of the other one against mine [rad], where I am now."""
    turning: bool
    """Whether my path turns before I am there."""
    place: Place
    """Where it is now [m]."""


def outlook(path: Path, s: float, vehicle: VehicleFacts) -> Outlook:
    """What lies before the car at arc length s."""
    distance = np.arange(0.0, LOOK_M, STRIDE_M)
    cells = cells_of(path, s + distance)
    boxes = footprints(path, vehicle.length, vehicle.width + 2 * SIDE_M, cells)
    return Outlook(distance, path.yaw[cells], boxes)


def leaders(me: Mover, ahead: Outlook, objects: Objects) -> list[Leader]:
    """Everything that is on the path now, but for cars beside me that go my way and have less of a lead than I have."""
    met = _met_now(ahead, objects)
    rows = np.flatnonzero(met.any(0) & ~beside(me, ahead, objects))
    first: Int = met[:, rows].argmax(0) + 1
    along = np.maximum(objects.speed[rows] * np.cos(objects.yaw[rows] - ahead.yaw[first]), 0.0)
    return [Leader(*pair) for pair in zip(ahead.distance[first].tolist(), along.tolist(), strict=True)]


def rows_on_way(me: Mover, ahead: Outlook, objects: Objects) -> Int:
    """Rows of the objects of `leaders`."""
    return np.flatnonzero(_met_now(ahead, objects).any(0) & ~beside(me, ahead, objects))


def _met_now(ahead: Outlook, objects: Objects) -> Bool:
    """(A - 1, N) which stations ahead of the car which objects are on now."""
    return overlaps(ahead.boxes[1:], _boxes(objects, np.arange(len(objects.ids)), 0.0))


def beside(me: Mover, ahead: Outlook, objects: Objects) -> Bool:
    """Who drives as I do and is behind my middle, or level with it and further east: they mind me (N,)."""
    x, y = ahead.boxes[0].mean(0)
    lead = (objects.x - x) * np.cos(ahead.yaw[0]) + (objects.y - y) * np.sin(ahead.yaw[0])
    later = (objects.x > me.place[0]) | ((objects.x == me.place[0]) & (objects.y > me.place[1]))
    return same_way(ahead, objects) & ((lead < -LEVEL_M) | ((lead < LEVEL_M) & later))


def same_way(ahead: Outlook, objects: Objects) -> Bool:
    """Who drives in about my direction (N,)."""
    return np.cos(objects.yaw - ahead.yaw[0]) > math.cos(SAME_WAY)


def crossings(ahead: Outlook, objects: Objects, curvature: Float) -> list[Crossing]:
    """Everybody near who will cross the path, turning on as they do now: curvature (N,) [1/m] of the objects' ways."""
    near = np.hypot(*(ahead.boxes[0].mean(0)[:, None] - np.array((objects.x, objects.y)))) < LOOK_M
    rows = np.flatnonzero(near & (objects.kind != Kind.STATIC))
    travelled = np.arange(0.0, LOOK_M, STRIDE_M)
    swept = _boxes(objects, rows[:, None], travelled, curvature[rows, None])
    met = overlaps(ahead.boxes, swept.reshape(-1, 4, 2)).reshape(len(ahead.distance), *swept.shape[:2])
    return [_crossing(ahead, objects, row, met[:, k]) for k, row in enumerate(rows.tolist()) if met[:, k].any()]


def _crossing(ahead: Outlook, objects: Objects, row: int, met: Bool) -> Crossing:
    """met: (A, K) which of my stations the other one overlaps after so many strides."""
    mine, theirs = np.flatnonzero(met.any(1)), np.flatnonzero(met.any(0))
    standing = float(objects.speed[row]) < MOVING_SPEED
    speed = MOVING_SPEED if standing else float(objects.speed[row])
    return Crossing(
        id=objects.ids[row],
        first=float(ahead.distance[mine[0]]),
        last=float(ahead.distance[mine[-1]]),
        arrives_s=float(theirs[0]) * STRIDE_M / speed,
        leaves_s=float(theirs[-1] + 1) * STRIDE_M / speed,
        standing=standing,
        bearing=wrap_angle(float(objects.yaw[row] - ahead.yaw[0])),
        turning=abs(float(ahead.yaw[mine[0]] - ahead.yaw[0])) > SIDE_ANGLES[0],
        place=(float(objects.x[row]), float(objects.y[row])),
    )


def gives_way(me: Mover, other: Crossing, before: bool, bold: bool) -> bool:
    """Whether I let the other one go first: it is there earlier, or wins a tie; if both stand that is one.

    Whoever gave way `before` goes on to do so while the other one is not clearly later; the bold one wins every tie.
    """
    here_s, gone_s = me.time_to(other.first), me.time_to(other.last)
    if here_s > other.leaves_s + GAP_S or gone_s + GAP_S < other.arrives_s:
        return False
    lead = other.arrives_s - here_s
    if (other.standing and me.speed < MOVING_SPEED) or abs(lead) < TIE_S:
        return not bold and _loses_tie(me, other)
    return lead < (HOLD_S if before and not bold else 0.0)


def _loses_tie(me: Mover, other: Crossing) -> bool:
    """Right before left; straight before turning; then the one further west."""
    low, high = SIDE_ANGLES
    if low < abs(other.bearing) < high:
        return other.bearing > 0  # it crosses from my right to my left
    return other.turning or other.place < me.place


def _boxes(objects: Objects, rows: Int, travelled: Float | float, curvature: Float | float = 0.0) -> Float:
    """Corners of the chosen objects' boxes after so many metres on circles (a right angle at most); all broadcast."""
    turned = np.clip(curvature * travelled, -math.pi / 2, math.pi / 2)
    # A chord of length travelled: exact for small turns, and long turns are guesses anyway.
    middle = objects.yaw[rows] + turned / 2
    return boxes_corners(
        objects.x[rows] + travelled * np.cos(middle),
        objects.y[rows] + travelled * np.sin(middle),
        objects.yaw[rows] + turned,
        objects.length[rows],
        objects.width[rows],
    )


class Memory:
    """How the others turn: their directions when last seen, for nobody says how fast he turns."""

    def __init__(self) -> None:
        self._yaws: dict[str, float] = {}

    def curvature(self, objects: Objects, elapsed_s: float) -> Float:
        """(N,) [1/m] of the ways of the objects since they were last seen; 0 for whoever is new or stands."""
        seen = dict(zip(objects.ids, objects.yaw.tolist(), strict=True))
        turned = np.array([wrap_angle(yaw - self._yaws.get(name, yaw)) for name, yaw in seen.items()])
        self._yaws = seen
        way = np.maximum(np.abs(objects.speed), 2 * MOVING_SPEED) * elapsed_s
        return np.clip(turned / way, -SHARPEST, SHARPEST)
