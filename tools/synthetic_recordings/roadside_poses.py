"""Poses beside the lanes on the two maps: where people walk, wait and ride, and where vehicles park.

Both networks have the same cross-section on every road: car lanes, 2.2 m of parking, a pavement of 2.5 m.
"""

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import Lane, RoadMap

PARKING_M, PAVEMENT_M = 2.2, 2.5
"""Widths in the recipes (`networks/city_crossing`, `networks/city_corridor`)."""
RIDE_M = 0.6
"""[m] Distance of cyclists from the lane's edge, in the empty parking strip."""
RoadsidePose = tuple[float, float, float]
"""x, y [m], yaw [rad]"""


@dataclass(frozen=True)
class SignalledCrossing:
    """A pedestrian crossing: its ends and green times."""

    line: Float
    """(2, 2) [m], from kerb to kerb."""
    green: tuple[tuple[float, float], ...]
    """Intervals [s] within `cycle_s`; () without traffic lights."""
    cycle_s: float


def find_kerb_lanes(roads: RoadMap) -> list[Lane]:
    """Return the rightmost car lane of every road."""
    return [lane for lane in roads.driving if not lane.junction and not lane.right]


def compute_roadside_pose(lane: Lane, s: float, right_m: float) -> RoadsidePose:
    """Return a pose to the right of a lane's centre at arc length s [m]."""
    (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
    return round(x + right_m * float(np.sin(yaw)), 3), round(y - right_m * float(np.cos(yaw)), 3), round(float(yaw), 4)


def compute_parking_pose(lane: Lane, s: float) -> RoadsidePose:
    """Return a pose in the middle of the parking strip."""
    return compute_roadside_pose(lane, s, lane.width / 2 + PARKING_M / 2)


def compute_cycling_pose(lane: Lane, s: float) -> RoadsidePose:
    """Return a pose in the parking strip, near the lane."""
    return compute_roadside_pose(lane, s, lane.width / 2 + RIDE_M)


def compute_walking_pose(lane: Lane, s: float, aside: float) -> RoadsidePose:
    """Return a pose on the pavement, `aside` from -1 (at the kerb) to 1 (at the houses)."""
    return compute_roadside_pose(lane, s, lane.width / 2 + PARKING_M + PAVEMENT_M / 2 * (1 + 0.8 * aside))


def find_crossings(roads: RoadMap) -> list[SignalledCrossing]:
    """Return the crossings with their green times from the net file, in the order of `RoadMap.crossings`."""
    net = ET.fromstring(gzip.decompress(roads.net_file.read_bytes()))
    lights = {
        way.attrib["to"]: (way.attrib["tl"], int(way.attrib["linkIndex"]))
        for way in net.iter("connection")
        if "tl" in way.attrib
    }
    names = [edge.attrib["id"] for edge in net.iter("edge") if edge.get("function") == "crossing"]
    return [
        _build_crossing(net, line, lights.get(name)) for name, (line, _) in zip(names, roads.crossings, strict=True)
    ]


def _build_crossing(net: ET.Element, line: Float, light: tuple[str, int] | None) -> SignalledCrossing:
    ends = line[[0, -1]]
    if light is None:
        return SignalledCrossing(ends, (), 0.0)
    phases = list(_list_phases(net, light[0]))
    green = tuple((begin, end) for begin, end, state in phases if state[light[1]] in "Gg")
    return SignalledCrossing(ends, green, phases[-1][1])


def _list_phases(net: ET.Element, light: str) -> Iterator[tuple[float, float, str]]:
    """Yield begin and end [s] and state of every phase."""
    now = 0.0
    for program in net.iter("tlLogic"):
        if program.attrib["id"] == light:
            for phase in program.iter("phase"):
                end = now + float(phase.attrib["duration"])
                yield now, end, phase.attrib["state"]
                now = end
