"""SignalLampObserver: which brake lamps and indicators shine, from the motion of vehicles in successive frames.

Frames and recordings hold no lamps, so lamps follow from what vehicles do, and a replay shows those of the drive.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angle, wrap_angles
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind, RoadUsers
from mdrive_sumo.roads import Lane, RoadMap

BRAKE_ON_MPS2, BRAKE_OFF_MPS2 = 1.3, 0.7
"""Decelerations from which brake lamps must, and up to which they must not shine (UN Regulation 13-H, 5.2.22.4)."""
SMOOTHING = 0.3
"""Weight of the newest tick's acceleration: SUMO's drivers dawdle from tick to tick."""
STANDING_MPS = 0.1
"""A slower vehicle stands."""
SLOWEST_TURN_MPS = 1.0
"""Below it the radius of a bend is noise."""
TURN_RADIUS_M = 25.0
"""Within a junction, who drives a narrower bend turns."""
ASIDE_MPS = 0.7
"""Speed across its lane from which a vehicle changes lanes; SUMO's vehicles take 2 s from lane to lane."""
ALONG_RAD, ON_LANE_M = 0.6, 3.0
"""Up to this angle and distance a vehicle is on its nearest lane."""
TURN_RAD = math.pi / 6
"""A smaller change of direction over a junction is straight on, without indicator."""
TURN_AHEAD_M = 30.0
"""Before a junction where all ways of a lane turn to one side."""
HOLD_TICKS = TICKS_PER_SECOND // 2
"""Half a second: an indicator goes on through a gap in what shows the turn."""
FORGET_TICKS = 5 * TICKS_PER_SECOND
"""A vehicle that was out of the world for longer starts anew."""


class SignalLamp(IntFlag):
    """Lamps by which a driver tells others what it does; the numbers are those of the shaders."""

    BRAKE = 1
    LEFT = 2
    RIGHT = 4


@dataclass(slots=True)
class _Driver:
    """What is remembered of a vehicle."""

    tick: int
    x: float
    y: float
    yaw: float
    speed: float
    acceleration: float = 0.0
    has_moved: bool = False
    is_braking: bool = False
    side: int = 0
    side_tick: int = 0


class SignalLampObserver:
    """Observes the vehicles of one episode in ascending ticks."""

    def __init__(self, roads: RoadMap) -> None:
        self._roads = roads
        self._drivers: dict[str, _Driver] = {}

    def observe(self, tick: int, boxes: RoadUsers) -> Mapping[str, int]:
        """Return the `SignalLamp`s that shine, by id of vehicles with any."""
        rows = np.flatnonzero(boxes.kind == Kind.VEHICLE)
        places = _LanePlaces.find(self._roads, boxes, rows) if len(rows) else None
        lamps: dict[str, int] = {}
        for i, row in enumerate(rows.tolist()):
            name = boxes.ids[row]
            x, y, yaw, speed = (float(values[row]) for values in (boxes.x, boxes.y, boxes.yaw, boxes.speed))
            driver = self._drivers.get(name)
            if driver is None or not 0 < tick - driver.tick <= FORGET_TICKS:
                self._drivers[name] = _Driver(tick, x, y, yaw, speed)
                continue
            assert places is not None
            seconds = (tick - driver.tick) * DT
            turn_rate = wrap_angle(yaw - driver.yaw) / seconds
            velocity = (x - driver.x) / seconds, (y - driver.y) / seconds
            _update_brake(driver, speed, seconds)
            _update_side(driver, tick, places.find_side(i, turn_rate, velocity))
            driver.tick, driver.x, driver.y, driver.yaw, driver.speed = tick, x, y, yaw, speed
            if lit := _list_lamps(driver):
                lamps[name] = lit
        return MappingProxyType(lamps)


def _update_brake(driver: _Driver, speed: float, seconds: float) -> None:
    now = (speed - driver.speed) / seconds
    driver.acceleration += SMOOTHING * (now - driver.acceleration)
    driver.has_moved |= speed > STANDING_MPS
    limit = BRAKE_OFF_MPS2 if driver.is_braking else BRAKE_ON_MPS2
    is_held = speed <= STANDING_MPS and driver.has_moved
    driver.is_braking = is_held or driver.acceleration <= -limit


def _update_side(driver: _Driver, tick: int, side: int) -> None:
    if side:
        driver.side, driver.side_tick = side, tick
    elif tick - driver.side_tick > HOLD_TICKS:
        driver.side = 0


def _list_lamps(driver: _Driver) -> int:
    side = {1: SignalLamp.LEFT, -1: SignalLamp.RIGHT}.get(driver.side, SignalLamp(0))
    return int(side | (SignalLamp.BRAKE if driver.is_braking else SignalLamp(0)))


@dataclass(frozen=True, slots=True)
class _LanePlaces:
    """Where vehicles (N,) are relative to their nearest lanes."""

    in_junction: Bool
    direction: tuple[Float, Float]
    """Of the lanes: cosine and sine."""
    is_on_lane: Bool
    turn_ahead: Int
    """1 or -1 where all ways ahead turn left or right."""

    @classmethod
    def find(cls, roads: RoadMap, boxes: RoadUsers, rows: Int) -> "_LanePlaces":
        xy = np.column_stack((boxes.x[rows], boxes.y[rows]))
        nearest, ways = roads.find_nearest_lanes(xy), _find_ways(roads)
        is_along = np.abs(wrap_angles(boxes.yaw[rows] - nearest.yaw)) < ALONG_RAD
        to_end = xy - ways.end[nearest.lane]
        is_near = portable.hypot(to_end[:, 0], to_end[:, 1]) < TURN_AHEAD_M
        is_on_lane = (nearest.distance < ON_LANE_M) & is_along
        turn_ahead = np.where(is_near & is_on_lane, ways.turn[nearest.lane], 0)
        return cls(roads.in_junction[nearest.lane], portable.cos_sin(nearest.yaw), is_on_lane, turn_ahead)

    def find_side(self, i: int, turn_rate: float, velocity: tuple[float, float]) -> int:
        """Return 1 for the left, -1 for the right indicator, 0 for none. velocity: x, y [m/s]."""
        speed = portable.hypot(*velocity)
        if self.in_junction[i]:
            turns = speed > SLOWEST_TURN_MPS and abs(turn_rate) * TURN_RADIUS_M > speed
            return int(math.copysign(1, turn_rate)) if turns else 0
        cos, sin = self.direction
        aside = float(cos[i]) * velocity[1] - float(sin[i]) * velocity[0]
        if self.is_on_lane[i] and abs(aside) > ASIDE_MPS:
            return int(math.copysign(1, aside))
        return int(self.turn_ahead[i])


@dataclass(frozen=True, slots=True)
class _Ways:
    """Of the driving lanes (L,): their ends (L, 2) [m], and the side to which all ways from there turn."""

    end: Float
    turn: Int


@lru_cache(maxsize=2)
def _find_ways(roads: RoadMap) -> _Ways:
    end = np.array([lane.centre.xy[-1] for lane in roads.driving])
    return _Ways(end, np.array([_find_common_turn(roads, lane) for lane in roads.driving]))


def _find_common_turn(roads: RoadMap, lane: Lane) -> int:
    """Return the side to which all ways from a lane through the next junction turn, else 0."""
    ways = [roads.lanes[name] for name in lane.successors]
    turns = {_find_turn(lane_through) for lane_through in ways if lane_through.junction}
    return turns.pop() if len(turns) == 1 and not lane.junction else 0


def _find_turn(lane: Lane) -> int:
    turn = wrap_angle(lane.centre.yaw_at(lane.centre.length) - lane.centre.yaw_at(0.0))
    return 0 if abs(turn) < TURN_RAD else int(math.copysign(1, turn))
