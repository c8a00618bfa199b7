"""Pedestrian crossings of a network and when people have green there."""

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap


@dataclass(frozen=True)
class SignalledCrossing:
    """A pedestrian crossing: its ends and green times."""

    line: Float
    """(2, 2) [m], from kerb to kerb."""
    green: tuple[tuple[float, float], ...]
    """Intervals [s] within `cycle_s`; () without traffic lights."""
    cycle_s: float


@lru_cache(maxsize=32)
def find_signalled_crossings(roads: RoadMap) -> tuple[SignalledCrossing, ...]:
    """Return the crossings with their green times from the net file, in the order of `RoadMap.crossings`."""
    net = ET.fromstring(gzip.decompress(roads.net_file.read_bytes()))
    light_by_edge = {
        way.attrib["to"]: (way.attrib["tl"], int(way.attrib["linkIndex"]))
        for way in net.iter("connection")
        if "tl" in way.attrib
    }
    names = [edge.attrib["id"] for edge in net.iter("edge") if edge.get("function") == "crossing"]
    found: list[SignalledCrossing] = []
    for name, (line, _) in zip(names, roads.crossings, strict=True):
        light, index = light_by_edge.get(name, ("", 0))
        phases = list(_list_phases(net, light))
        green = tuple((begin, end) for begin, end, state in phases if state[index] in "Gg")
        found.append(SignalledCrossing(line[[0, -1]], green, phases[-1][1] if phases else 0.0))
    return tuple(found)


def has_green_at_start(roads: RoadMap, approach: str, inside: str) -> bool:
    """Return whether the light between a lane and the junction lane behind it is green when its program begins."""
    light, index = roads.lanes[approach].lights[inside].rsplit(":", 1)
    net = ET.fromstring(gzip.decompress(roads.net_file.read_bytes()))
    _, _, state = next(_list_phases(net, light))
    return state[int(index)] in "Gg"


def _list_phases(net: ET.Element, light: str) -> Iterator[tuple[float, float, str]]:
    """Yield begin and end [s] and state of every phase of a light."""
    now = 0.0
    for program in net.iter("tlLogic"):
        if program.attrib["id"] == light:
            for phase in program.iter("phase"):
                end = now + float(phase.attrib["duration"])
                yield now, end, phase.attrib["state"]
                now = end
