"""Checks of a road network: what of it CAVs can drive."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.vehicle.dynamics import MKZ_2017

LEAST_WAY_M = 30.0
"""[m] A network whose longest way is shorter has no room to start, to meet another CAV, and to arrive."""
LEAST_WIDTH_M = MKZ_2017.width + 0.2
"""[m] Of a lane: the car of every CAV, and 10 cm on either side."""
GAP_M = 1.5
"""[m] Between the end of a lane and the begin of its successor: points of a route are at most this far apart."""
BEND_M = 3.0
"""[m] Stretch over which a bend is measured: that of the checks of packaged suites."""
U_TURN_RAD = 2.2
"""[rad] Of 126 degrees: a lane that turns by more leads back."""
LEAST_RADIUS_M = 4.5
"""[m] A tighter bend is a kink, which no car drives."""


@dataclass(frozen=True)
class Drivability:
    """What CAVs can drive of a network."""

    lanes: int
    """Lanes for cars outside junctions."""
    metres: float
    """Their length [m]."""
    junctions: int
    """Junctions at which ways cross or merge."""
    findings: tuple[str, ...]
    """What is wrong with lanes, one sentence each."""


def check_drivability(where: str, roads: RoadMap) -> Drivability:
    """Return the checks of a network. Raises InputError for one on which no CAV could drive."""
    ways = [lane for lane in roads.driving if not lane.junction]
    if not ways:
        raise InputError(f"{where}: expected lanes that cars may use, found none")
    reach = max(lane.centre.length + _measure_ahead(roads, lane) for lane in ways)
    if reach < LEAST_WAY_M:
        raise InputError(
            f"{where}: expected a way of at least {LEAST_WAY_M:g} m over connected lanes, found {reach:.1f} m"
        )
    nodes = {lane[1:].rpartition("_")[0].rpartition("_")[0] for lane in roads.junction_controls}
    metres = sum(lane.centre.length for lane in ways)
    return Drivability(len(ways), metres, len(nodes), tuple(_find_faults(roads, ways)))


def _measure_ahead(roads: RoadMap, lane: Lane) -> float:
    """Return the length [m] of the longest successor, with the lane behind a junction."""
    lengths = [0.0]
    for name in lane.successors:
        after = roads.lanes[name]
        beyond = [roads.lanes[one].centre.length for one in after.successors] if after.junction else []
        lengths.append(after.centre.length + max(beyond, default=0.0))
    return max(lengths)


def _find_faults(roads: RoadMap, ways: list[Lane]) -> Iterator[str]:
    if len(parts := _find_parts(roads)) > 1:
        alone = sum(len(part) for part in parts[1:])
        yield f"{len(parts)} parts are not connected: no way leads between the largest and {alone} lanes of the others"
    if narrow := [lane.id for lane in ways if lane.width < LEAST_WIDTH_M]:
        yield f"{len(narrow)} lanes are narrower than {LEAST_WIDTH_M:g} m, such as {narrow[0]}: no CAV fits on them"
    if apart := [pair for lane in roads.driving for pair in _find_gaps(roads, lane)]:
        yield f"{len(apart)} lanes begin over {GAP_M:g} m beside the end of the one before, such as {apart[0]}"
    if kinks := [lane.id for lane in roads.driving if _has_kink(lane)]:
        yield (
            f"{len(kinks)} lanes turn in less than {LEAST_RADIUS_M:g} m of radius, such as {kinks[0]}: a CAV leaves its"
            " lane there"
        )


def _find_parts(roads: RoadMap) -> list[set[str]]:
    """Return the sets of roads that are connected whichever way one drives, the largest first."""
    links: dict[str, set[str]] = {lane.id: set() for lane in roads.driving}
    for lane in roads.driving:
        for other in (*lane.successors, lane.left, lane.right):
            if other:
                links[lane.id].add(other)
                links[other].add(lane.id)
    parts: list[set[str]] = []
    left = set(links)
    while left:
        part, ahead = set[str](), [min(left)]
        while ahead:
            lane = ahead.pop()
            if lane not in part:
                part.add(lane)
                ahead.extend(links[lane] - part)
        left -= part
        parts.append({lane for lane in part if not roads.lanes[lane].junction})
    return sorted(parts, key=len, reverse=True)


def _find_gaps(roads: RoadMap, lane: Lane) -> Iterator[str]:
    x, y = lane.centre.xy[-1]
    for after in lane.successors:
        begin = roads.lanes[after].centre.xy[0]
        if np.hypot(begin[0] - x, begin[1] - y) > GAP_M:
            yield f"{after} after {lane.id}"


def _has_kink(lane: Lane) -> bool:
    if lane.centre.length < BEND_M:
        return False
    if abs(np.angle(np.exp(1j * (lane.centre.yaws[-1] - lane.centre.yaws[0])))) > U_TURN_RAD:
        return False  # where a road ends netconvert lets traffic turn back; routes do not lead there
    stations = np.arange(0.0, lane.centre.length - BEND_M, 1.0)
    before, after = lane.centre.yaws_at(stations), lane.centre.yaws_at(stations + BEND_M)
    turns = np.abs(np.angle(np.exp(1j * (after - before))))
    return bool((turns > BEND_M / LEAST_RADIUS_M).any())
