"""Ways along streets: from one end of a place to the other, the traffic of the other direction, kerbs and stops."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import build_polyline, wrap_angle, wrap_angles
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    RouteLine,
    build_route_line,
    compute_lane_begins,
)
from mdrive_sumo.worlds.traffic.lane_walk import find_entries

LEAST_WAY_M = 150.0
"""[m] Shorter ways are arms of junctions, on which nothing comes up to its speed."""
BESIDE_M = 9.0
"""[m] The other direction of a street lies at most so far beside the way: a lane, and a lane or a narrow median."""
SAME_STREET = 0.7
"""Share of a way along which the other direction must run for both to be of one street."""
ROW_REACH_M = 6.0
"""[m] A parked row that serves a lane lies so close to its centre line: half a lane, a cycle lane and half a row."""
JUNCTION_M = 15.0
"""[m] Nothing stands in a lane nearer than this to its ends."""
ALIGNED_RAD = 0.3
"""A row along a street runs along its lane within this angle; stalls in front gardens stand across."""


@dataclass(frozen=True, slots=True)
class StreetWay:
    """A chain of lanes straight on through a place, and that of the other direction beside it."""

    lanes: Lanes
    oncoming: Lanes
    """() on a one-way road."""
    length: float
    """[m]"""


@lru_cache(maxsize=128)
def find_street_ways(roads: RoadMap) -> tuple[StreetWay, ...]:
    """Return the ways from end to end, longest first."""
    chains = [chain for name in find_entries(roads) if (chain := _follow(roads, roads.lanes[name]))]
    ways = [
        StreetWay(chain, _find_oncoming(roads, chain, chains), build_route_line(roads, chain).curve.length)
        for chain in chains
    ]
    return tuple(sorted((way for way in ways if way.length >= LEAST_WAY_M), key=lambda way: (-way.length, way.lanes)))


def select_ways(roads: RoadMap, fits: Callable[[StreetWay], bool]) -> tuple[StreetWay, ...]:
    """Return the ways that fit. Raises ProposalRejected if none does."""
    found = tuple(way for way in find_street_ways(roads) if fits(way))
    if not found:
        raise ProposalRejected(
            PipelineStage.WAYS, f"network {roads.name}: expected a street as the family needs it, found none"
        )
    return found


def _follow(roads: RoadMap, lane: Lane) -> Lanes:
    """Return the lanes straight on from a lane to the end of the place."""
    lanes = [lane.id]
    while others := [roads.lanes[one] for one in lane.successors if one not in lanes]:
        last = lane
        lane = min(others, key=lambda one: (_measure_turn(roads, last, one), one.id))
        lanes.append(lane.id)
    return tuple(lanes)


def _measure_turn(roads: RoadMap, begin: Lane, end: Lane) -> float:
    """Return how far [rad] the way turns from one lane through the next to where that leads."""
    target = end
    while target.junction and target.successors:
        target = roads.lanes[target.successors[0]]
    return round(abs(wrap_angle(target.centre.yaw_at(0.0) - begin.centre.yaw_at(begin.centre.length))), 6)


def _find_oncoming(roads: RoadMap, chain: Lanes, chains: Sequence[Lanes]) -> Lanes:
    """Return the chain nearest to a chain that runs the other way along it; () without one."""
    best: tuple[float, Lanes] = (math.inf, ())
    own = build_route_line(roads, chain)
    for other in chains:
        away = _measure_oncoming(own, build_route_line(roads, other))
        best = min(best, (away, other))
    return best[1]


def _measure_oncoming(own: RouteLine, other: RouteLine) -> float:
    """Return the mean distance [m] of a line that runs the other way along another one; infinite if it does not."""
    points, yaws = own.xy[::5], own.yaw[::5]
    gaps = portable.hypot(*(points[:, None] - other.xy[None, ::5]).transpose(2, 0, 1))
    nearest = gaps.argmin(axis=1)
    least = gaps[np.arange(len(points)), nearest]
    turned = np.abs(wrap_angles(yaws - other.yaw[::5][nearest]))
    beside = (least < BESIDE_M) & (turned > math.pi - 2 * ALIGNED_RAD)
    return float(least[beside].mean()) if beside.mean() >= SAME_STREET else math.inf


@dataclass(frozen=True, slots=True)
class Kerb:
    """A stretch of a way beside which vehicles park in a row."""

    begin: float
    """Station [m] along the way."""
    end: float
    offset: float
    """[m] Of the middle of the row to the left of the way; negative: to the right."""


@lru_cache(maxsize=256)
def find_kerbs(roads: RoadMap, lanes: Lanes) -> tuple[Kerb, ...]:
    """Return the parked rows at the right of a chain of lanes, in driving order."""
    curve = build_route_line(roads, lanes).curve
    found: list[Kerb] = []
    for row in roads.parking:
        line = build_polyline(row.line)
        (x, y), yaw = line.at(line.length / 2), line.yaw_at(line.length / 2)
        station, offset = curve.project(x, y)
        turned = wrap_angle(yaw - curve.yaw_at(station))
        is_along = abs(turned) < ALIGNED_RAD or abs(turned) > math.pi - ALIGNED_RAD
        if is_along and -ROW_REACH_M < offset < 0.0 and 5.0 < station < curve.length - 5.0:
            ends = sorted(curve.project(*line.at(at))[0] for at in (0.0, line.length))
            found.append(Kerb(ends[0], ends[1], offset))
    return tuple(sorted(found, key=lambda kerb: kerb.begin))


@lru_cache(maxsize=256)
def find_right_lanes(roads: RoadMap, lanes: Lanes) -> tuple[Kerb, ...]:
    """Return the stretches of a chain of lanes with another lane at its right, in which vehicles may stand."""
    begins = compute_lane_begins(roads, lanes)
    pairs = [(begin, roads.lanes[lane]) for begin, lane in zip(begins, lanes, strict=True) if roads.lanes[lane].right]
    return tuple(
        Kerb(
            begin + JUNCTION_M,
            begin + lane.centre.length - JUNCTION_M,
            -(lane.width + roads.lanes[lane.right].width) / 2,
        )
        for begin, lane in pairs
        if lane.centre.length > 3 * JUNCTION_M and not roads.lanes[lane.right].right
    )


def compute_rise_s(distance: float, speed: float, acceleration: float) -> float:
    """Return the time [s] in which someone who stands covers a distance [m] and accelerates [m/s2] up to a speed."""
    rising_m = speed * speed / (2 * acceleration)
    if distance <= rising_m:
        return math.sqrt(2 * distance / acceleration)
    return speed / acceleration + (distance - rising_m) / speed


@lru_cache(maxsize=256)
def find_zebras(roads: RoadMap, lanes: Lanes) -> tuple[float, ...]:
    """Return the stations [m] at which pedestrian crossings lead over a chain of lanes."""
    line = build_route_line(roads, lanes)
    path = shapely.LineString(line.xy)
    met = [path.intersection(shapely.LineString(crossing)) for crossing, _ in roads.crossings]
    return tuple(sorted(line.locate(*one.centroid.coords[0]) for one in met if not one.is_empty))


@lru_cache(maxsize=256)
def find_obstacles_beside(roads: RoadMap, lanes: Lanes, kinds: tuple[str, ...]) -> tuple[tuple[float, float], ...]:
    """Return station [m] of the far end and offset [m] to the left of the middle, of things at the right of a chain.

    kinds: of the names of the place's buildings.
    """
    curve = build_route_line(roads, lanes).curve
    found: list[tuple[float, float]] = []
    for building in roads.buildings:
        if building.id.startswith(kinds):
            places = [curve.project(x, y) for x, y in building.outline.tolist()]
            offset = sum(place[1] for place in places) / len(places)
            if -ROW_REACH_M < offset < 0.0:
                found.append((max(place[0] for place in places), offset))
    return tuple(sorted(found))
