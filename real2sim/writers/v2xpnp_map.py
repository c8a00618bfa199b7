"""Write vector maps in V2XPnP's format: a pickle that names the original classes, without requiring them.

The pickle is assembled opcode by opcode (see Python's pickletools), because pickle.dump needs importable modules of
those names. The original code base can unpickle it.
"""

import re
import struct
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import write_bytes
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.readers.v2xpnp_map import LANE_KINDS, MODULE


@dataclass(frozen=True, slots=True)
class _PickledObject:
    """An instance of an original class."""

    name: str
    fields: "Mapping[str, _PickledValue]"


@dataclass(frozen=True, slots=True)
class _PickledLaneType:
    value: int


_PickledValue = _PickledObject | _PickledLaneType | int | float | str | None | Sequence["_PickledValue"]
_TYPES = {kind: number for number, kind in LANE_KINDS.items()} | {LaneKind.BIKE: 3}
"""The format has no cycle lanes; they are written as shoulders."""


def write_vector_map(hd_map: HdMap, path: Path) -> Mapping[str, str]:
    """Write a map; return the "road_lane" name of each lane id.

    The format cannot represent widths, limits, neighbours, directions, stop lines and ids of traffic lights; the two
    boundaries of a lane become one list.
    """
    numbers = assign_lane_numbers(hd_map)
    names = {lane: f"{road}_{place}" for lane, (road, place) in numbers.items()}
    lanes = [_build_lane(lane, numbers[lane.id], names) for lane in hd_map.lanes.values()]
    crosswalks = [
        _PickledObject("Crosswalk", {"polygon": _build_points(polygon), "id": i})
        for i, polygon in enumerate(hd_map.crosswalks)
    ]
    fields: dict[str, _PickledValue] = {
        "map_features": [*lanes, *crosswalks],
        "dynamic_states": _build_dynamic_states(hd_map),
    }
    write_bytes(path, b"\x80\x02" + _encode(_PickledObject("Map", fields)) + b".")
    return names


def assign_lane_numbers(hd_map: HdMap) -> dict[str, tuple[int, int]]:
    """Return road_id and lane_id of every lane: those in the ids if all are "road_lane", else counters.

    Lanes of one group, or else neighbours, become one road, counted from left to right from 1.
    """
    parts = {name: re.fullmatch(r"(-?[1-9][0-9]*|0)_(-?[1-9][0-9]*|0)", name) for name in hd_map.lanes}
    if all(parts.values()):
        return {name: (int(part[1]), int(part[2])) for name, part in parts.items() if part}
    roads: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for lane in hd_map.lanes.values():
        head, steps = _find_leftmost(hd_map, lane)
        roads[f"group {lane.group}" if lane.group else f"lane {head}"].append((steps, lane.id))
    return {name: (r, n) for r, row in enumerate(roads.values()) for n, (_, name) in enumerate(sorted(row), start=1)}


def _find_leftmost(hd_map: HdMap, lane: MapLane) -> tuple[str, int]:
    """Return the leftmost lane over neighbours, and the number of steps to it."""
    seen = [lane.id]
    while (left := hd_map.lanes[seen[-1]].left_neighbour) in hd_map.lanes and left not in seen:
        seen.append(left)
    return seen[-1], len(seen) - 1


def _build_lane(lane: MapLane, number: tuple[int, int], names: Mapping[str, str]) -> _PickledObject:
    fields: dict[str, _PickledValue] = {
        "road_id": number[0],
        "lane_id": number[1],
        "type": _PickledLaneType(_TYPES[lane.kind]),
        "polyline": _build_points(lane.centre),
        "entry_lanes": [names.get(name, name) for name in lane.entries],
        "exit_lanes": [names.get(name, name) for name in lane.exits],
        "boundary": [*_build_points(lane.left), *_build_points(lane.right)],
    }
    return _PickledObject("Lane", fields)


def _build_points(line: Float) -> list[_PickledObject]:
    return [_PickledObject("MapPoint", {"x": x, "y": y, "z": 0.0}) for x, y in line.tolist()]


def _build_dynamic_states(hd_map: HdMap) -> list[_PickledObject] | None:
    """Return one state with all controlled lanes unknown; None without traffic lights."""
    places = {name: i for i, name in enumerate(hd_map.lanes)}
    lit = sorted({places[lane] for lanes in hd_map.signals.values() for lane in lanes if lane in places})
    if not lit:
        return None
    states = [_PickledObject("TrafficSignalLaneState", {"lane": place, "state": "UNKNOWN"}) for place in lit]
    return [_PickledObject("DynamicState", {"timestamp_seconds": 0.0, "lane_states": states})]


def _encode_global(name: str) -> bytes:
    return f"c{MODULE}\n{name}\n".encode()


def _encode(value: _PickledValue) -> bytes:
    """Return opcodes (protocol 2) that leave the value on the stack."""
    match value:
        case None:
            return b"N"
        case int():
            return b"J" + struct.pack("<i", value)
        case float():
            return b"G" + struct.pack(">d", value)
        case str():
            text = value.encode()
            return b"X" + struct.pack("<I", len(text)) + text
        case _PickledLaneType():
            return _encode_global("LaneType") + _encode(value.value) + b"\x85R"
        case _PickledObject():
            state = b"".join(_encode(key) + _encode(field) for key, field in value.fields.items())
            return _encode_global(value.name) + b")\x81}(" + state + b"ub"
        case _:
            return b"](" + b"".join(map(_encode, value)) + b"e"
