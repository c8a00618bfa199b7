"""Ways through the junctions of a place: chains of lanes with their stop line, turn, control and speeds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.planning.reference_path import SPACING_M, build_path, compute_curve_speeds
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.lane_chains import Lanes, build_route_line, compute_lane_begins

TurnSide = Literal["straight", "left", "right"]
TURN_RAD = math.radians(45.0)
"""A way that turns by less goes straight on; arms of crossings of five arms are 68 degrees apart."""
BACK_M, AHEAD_M = 260.0, 160.0
"""[m] Lanes are added before and behind a junction until the way is that long there, or the network ends."""
LATERAL, BRAKING = 2.0, 3.0
"""[m/s2] Of the built-in planners in bends and before them (`planning.parameters`)."""


@dataclass(frozen=True, slots=True)
class JunctionWay:
    """A way through a junction: straight on over other junctions before and behind it, as far as the network goes."""

    lanes: Lanes
    index: int
    """Of the last lane before the junction in `lanes`."""
    junction: str
    """Name of the junction in the net."""
    stop_m: float
    """Station [m] along the lanes at which the junction begins."""
    exit_m: float
    """Station [m] at which the way leaves it."""
    turn: TurnSide
    control: JunctionKind | None
    """What controls the way into the junction; None: nothing, because no other way crosses or joins it."""
    limit: float
    """[m/s] Speed limit before the junction."""

    @property
    def approach(self) -> str:
        """The last lane before the junction."""
        return self.lanes[self.index]

    @property
    def inside(self) -> str:
        """The first lane inside the junction."""
        return self.lanes[self.index + 1]


@lru_cache(maxsize=128)
def find_junction_ways(roads: RoadMap) -> tuple[JunctionWay, ...]:
    """Return the ways through all junctions, sorted by their lanes; no U-turns."""
    before: dict[str, list[str]] = {}
    for lane in roads.driving:
        for there in lane.successors:
            before.setdefault(there, []).append(lane.id)
    ways = [
        _build_way(roads, before, lane, inside)
        for lane in roads.driving
        if not lane.junction
        for inside in lane.successors
        if roads.lanes[inside].junction
    ]
    return tuple(sorted((way for way in ways if way is not None), key=lambda way: way.lanes))


def _build_way(roads: RoadMap, before: Mapping[str, list[str]], approach: Lane, inside: str) -> JunctionWay | None:
    through = [approach.id, inside]
    while roads.lanes[through[-1]].junction:
        after = roads.lanes[through[-1]].successors
        if not after:
            return None
        through.append(after[0])
    turned = _compute_turn(approach, roads.lanes[through[-1]])
    if abs(turned) > math.pi - TURN_RAD / 2:
        return None
    back, ahead = _extend_back(roads, before, approach), _extend_ahead(roads, roads.lanes[through[-1]])
    lanes = (*back, *through, *ahead)
    begins = compute_lane_begins(roads, lanes)
    index = len(back)
    return JunctionWay(
        lanes,
        index,
        roads.lanes[inside].edge.rsplit("_", 1)[0],
        begins[index + 1],
        begins[index + len(through) - 1],
        "straight" if abs(turned) < TURN_RAD else "left" if turned > 0.0 else "right",
        roads.junction_controls.get(inside),
        approach.speed_limit,
    )


def _compute_turn(begin: Lane, end: Lane) -> float:
    """Return by how much [rad] a way turns from the end of a lane to the beginning of another, to the left."""
    return wrap_angle(end.centre.yaw_at(0.0) - begin.centre.yaw_at(begin.centre.length))


def _extend_back(roads: RoadMap, before: Mapping[str, list[str]], lane: Lane) -> list[str]:
    """Return the lanes that lead to a lane, the straightest ones."""
    lanes: list[str] = []
    length = lane.centre.length
    while length < BACK_M and (others := [one for one in before.get(lane.id, ()) if one not in lanes]):
        first = lane
        lane = min((roads.lanes[one] for one in others), key=lambda one: (_measure_bend(one, first), one.id))
        lanes.insert(0, lane.id)
        length += lane.centre.length
    return lanes


def _extend_ahead(roads: RoadMap, lane: Lane) -> list[str]:
    """Return the lanes to which a lane leads, the straightest ones."""
    lanes: list[str] = []
    length = lane.centre.length
    while length < AHEAD_M and (others := [one for one in lane.successors if one not in lanes]):
        last = lane
        lane = min((roads.lanes[one] for one in others), key=lambda one: (_measure_bend(last, one), one.id))
        lanes.append(lane.id)
        length += lane.centre.length
    return lanes


def _measure_bend(begin: Lane, end: Lane) -> float:
    """Return how much a way turns on the two lanes together [rad]."""
    whole = end.centre.yaw_at(end.centre.length) - begin.centre.yaw_at(0.0)
    return round(abs(wrap_angle(whole)), 6)


@dataclass(frozen=True, eq=False)
class WayTiming:
    """When a car that keeps to limits and slows down in bends is where on a way."""

    speed: Float
    """Speed (N,) [m/s] at every metre."""
    time: Float
    """Time (N,) [s] from the beginning to every metre."""

    def find_start(self, station: float, due_s: float) -> float:
        """Return the station [m] from which the car reaches a station after `due_s` [s]; negative if there is none."""
        begin = float(np.interp(station, np.arange(len(self.time)), self.time)) - due_s
        return float(np.interp(begin, self.time, np.arange(len(self.time)))) if begin >= 0.0 else begin

    def find_speed(self, station: float) -> float:
        """Return the speed [m/s] at a station."""
        return float(np.interp(station, np.arange(len(self.speed)), self.speed))

    def compute_between(self, begin: float, end: float) -> float:
        """Return the time [s] from one station to another."""
        first, last = np.interp((begin, end), np.arange(len(self.time)), self.time).tolist()
        return last - first


@lru_cache(maxsize=1024)
def compute_timing(roads: RoadMap, lanes: Lanes) -> WayTiming:
    """Return the timing of a car that drives a chain of lanes at the limits."""
    line = build_route_line(roads, lanes)
    path = build_path(line.xy, CAR.rear_to_centre)
    begins = compute_lane_begins(roads, lanes)
    at = np.arange(len(path.curvature)) * SPACING_M
    lane = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, len(lanes) - 1)
    limits = np.array([roads.lanes[name].speed_limit for name in lanes])[lane]
    speeds = compute_curve_speeds(path, float(limits.max()), LATERAL, BRAKING, limits)
    speed = np.interp(np.arange(len(line.xy)), at, np.maximum(speeds, 1.0))
    steps = 2.0 / (speed[1:] + speed[:-1])
    return WayTiming(speed, np.concatenate(((0.0,), np.cumsum(steps))))
