"""Carriageway of a motorway: sections along an axis, ramps that join and leave it, and what stands beside it."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.worlds.places.alignment import (
    buffer_line,
    compute_heading,
    compute_least_radius,
    cut_line,
    draw_bends,
    ease,
    find_point,
    join_lines,
    reverse_line,
    shift_line,
    trace_axis,
)
from mdrive_sumo.worlds.places.draft_edge import DraftEdge, DraftLane
from mdrive_sumo.worlds.places.frontage import Roadside, find_kerb
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node

SHOULDER_M = 2.5
"""[m] Hard shoulder beside the rightmost lane (RAA 2008, table 9: 2.50 m)."""
MEDIAN_M = 4.0
"""[m] Between both carriageways (RAA 2008, section 4.3: 4.00 m)."""
RAMP_LANE_M = 4.5
"""[m] Lane of a ramp with one lane (RAA 2008, section 6.4.3: cross-section Q 1)."""
MOTORWAY_PRIORITY, RAMP_PRIORITY = 9, 3
"""Priorities of edges for netconvert, of which only the order counts: the carriageway goes first."""
TAPER_M = 60.0
"""[m] Length of the wedge at the end of a lane (RAA 2008, section 6.4.4: 60 m)."""
PARALLEL_M = (80.0, 120.0)
"""[m] Range of the part of a ramp beside the carriageway; chosen: a car sees a gap for 4 s to 6 s before the nose."""
GAP_M = (9.0, 15.0)
"""[m] Range of the gap between a ramp and the carriageway where the ramp turns away; chosen."""
BANK_GAP_M = 6.0
"""[m] A bank between a ramp and the carriageway begins where the gap is that wide; chosen: near the nose both see."""
SCENERY = ("open", "noise_walls", "wood")


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a carriageway with the same lanes."""

    id: str
    length_m: float
    lanes: int
    end: str
    """Name of the node at its end."""
    end_type: str = "priority"
    """SUMO's type of that node."""
    right_m: float = 0.0
    """How far its lanes begin to the right of the axis."""


@dataclass(eq=False)
class Carriageway:
    """A carriageway in a draft. Lanes lie to the right of the axis."""

    draft: NetworkDraft
    axis: Polyline
    lane_m: float
    speed: float
    edges: dict[str, DraftEdge]
    """Edges of its sections by name."""


def draw_carriageway(
    draft: NetworkDraft, sections: Sequence[Section], lane_m: float, limit_kmh: float, axis: Polyline
) -> Carriageway:
    """Add the sections of a carriageway, one after the other along an axis, without connections."""
    draft.nodes.append(Node("start", *axis.at(0.0)))
    begin, where = 0.0, "start"
    edges: dict[str, DraftEdge] = {}
    for section in sections:
        end = min(begin + section.length_m, axis.length)
        is_last = section is sections[-1]
        draft.nodes.append(Node(section.end, *axis.at(end), "" if is_last else section.end_type, 1.5))
        line = shift_line(cut_line(axis, begin, end), -section.right_m)
        lanes = (DraftLane("drive", lane_m),) * section.lanes
        edges[section.id] = DraftEdge(section.id, where, section.end, line, lanes, limit_kmh / 3.6, MOTORWAY_PRIORITY)
        begin, where = end, section.end
    draft.edges += edges.values()
    return Carriageway(draft, axis, lane_m, limit_kmh / 3.6, edges)


def draw_axis(rng: random.Random, length_m: float, limit_kmh: float, sinuosity: float) -> Polyline:
    """Return the axis of a carriageway of a length, in any direction."""
    pieces = draw_bends(rng, length_m + 5.0, limit_kmh, sinuosity, (6.0, 22.0))
    return trace_axis((0.0, 0.0), rng.uniform(-math.pi, math.pi), pieces)


def connect_lanes(draft: NetworkDraft, before: str, after: str, pairs: Sequence[tuple[int, int]]) -> None:
    """Connect lanes of two edges, from the first index of each pair to the second."""
    draft.connections += [(before, a, after, b) for a, b in pairs]


def add_ramp(road: Carriageway, name: str, nose_m: float, lanes: int, limit_kmh: float, rng: random.Random) -> Polyline:
    """Add a ramp: an on-ramp ends and an off-ramp begins at the nose, right of `lanes` lanes; return its left edge.

    name: "on_ramp" or "off_ramp"; the node of the nose is that of the carriageway there. nose_m: its station. The
    ramp lies beside the carriageway, then turns away to the right with a bend that its own limit allows.
    """
    is_entry = name == "on_ramp"
    sign = -1.0 if is_entry else 1.0
    parallel = min(rng.uniform(*PARALLEL_M), nose_m - 5.0 if is_entry else road.axis.length - nose_m - 5.0)
    gap = rng.uniform(*GAP_M)
    far = nose_m + sign * parallel

    def place(station: float) -> float:
        """Return the distance [m] to the left of the axis, at a station of the cut line."""
        share = (parallel - station if is_entry else station) / parallel
        return -(lanes * road.lane_m + gap * ease(share))

    beside = shift_line(cut_line(road.axis, min(nose_m, far), max(nose_m, far)), place, 6.0)
    away = beside if not is_entry else reverse_line(beside)
    heading = compute_heading(road.axis, far) + (math.pi if is_entry else 0.0)
    radius = compute_least_radius(limit_kmh) * rng.uniform(1.0, 1.6)
    bend = radius * math.radians(rng.uniform(25.0, 60.0))
    turn = -sign * radius if is_entry else -radius
    rest = trace_axis(
        (float(away.xy[-1, 0]), float(away.xy[-1, 1])), heading, ((bend, turn), (rng.uniform(40.0, 70.0), 0.0))
    )
    line = join_lines(away, rest)
    line = reverse_line(line) if is_entry else line
    _add_ramp_edge(road, name, line, limit_kmh)
    return line


def _add_ramp_edge(road: Carriageway, name: str, line: Polyline, limit_kmh: float) -> None:
    is_entry = name == "on_ramp"
    street = Node(f"{name}_street", *line.at(0.0 if is_entry else line.length))
    nose = "join" if is_entry else "split"
    ends = (street.id, nose) if is_entry else (nose, street.id)
    road.draft.nodes.append(street)
    lanes = (DraftLane("drive", RAMP_LANE_M),)
    road.edges[name] = DraftEdge(name, *ends, line, lanes, limit_kmh / 3.6, RAMP_PRIORITY)
    road.draft.edges.append(road.edges[name])


def add_opposite_carriageway(road: Carriageway, lanes: int) -> None:
    """Add the carriageway of the other direction to the left of the axis, beyond the median."""
    line = reverse_line(shift_line(road.axis, MEDIAN_M))
    ends = [Node(name, *line.at(station)) for name, station in (("far_start", 0.0), ("far_end", line.length))]
    road.draft.nodes += ends
    width = (DraftLane("drive", road.lane_m),) * lanes
    road.edges["opposite"] = DraftEdge("opposite", "far_start", "far_end", line, width, road.speed, MOTORWAY_PRIORITY)
    road.draft.edges.append(road.edges["opposite"])


def add_bank(roadside: Roadside, road: Carriageway, name: str, nose_m: float, lanes: int) -> None:
    """Add an earth bank between a ramp and the carriageway: neither sees the other until the gap gets narrow."""
    ramp, sign = road.edges[name].line, -1 if name == "on_ramp" else 1
    right = lanes * road.lane_m
    inner, outer = list[tuple[float, float]](), list[tuple[float, float]]()
    for step in range(0, 130, 5):
        station = nose_m + sign * step
        if not 0.0 < station < road.axis.length:
            break
        gap = ramp.project(*find_point(road.axis, station, -right))[1]
        if gap >= BANK_GAP_M:
            inner.append(find_point(road.axis, station, -right - SHOULDER_M))
            outer.append(find_point(road.axis, station, -right - min(gap, 16.0) + 1.5))
    if len(inner) > 2:
        roadside.add("bank", np.array(inner + outer[::-1]), 0.5)


def furnish_motorway(roadside: Roadside, road: Carriageway, scenery: str, rng: random.Random) -> None:
    """Add hard shoulders and what stands beside them: noise walls, the edge of a wood, or a few farms far off."""
    for edge in road.draft.edges:
        kerb = find_kerb(edge)
        if edge.priority == MOTORWAY_PRIORITY:
            road.draft.paved_areas += _list_shoulders(roadside, kerb)
        if scenery == "noise_walls":
            roadside.add_strip("wall", kerb, SHOULDER_M + 1.5, 0.5)
        elif scenery == "wood":
            roadside.add_strip("wood", kerb, SHOULDER_M + rng.uniform(5.0, 8.0), 8.0, 15.0)


def add_taper(road: Carriageway, station: float, towards: int, right_m: float) -> None:
    """Pave the wedge in which the kerb moves by a lane: where a lane ends (towards: 1) or before it begins (-1).

    right_m: distance of the inner edge of that lane from the axis, to the right; the lane lies to the right of it.
    """
    length = min(TAPER_M, road.axis.length - station if towards > 0 else station)
    steps = [length * k / 6 for k in range(7)]
    inner = [find_point(road.axis, station + towards * step, -right_m) for step in steps]
    outer = [
        find_point(road.axis, station + towards * step, -right_m - road.lane_m * (1.0 - step / length))
        for step in steps
    ]
    road.draft.paved_areas.append(np.array(inner + outer[-2::-1]))


def _list_shoulders(roadside: Roadside, kerb: Polyline) -> list[np.ndarray]:
    """Return the outline of the shoulder along a kerb where no other road lies."""
    strip = shapely.Polygon(buffer_line(kerb, 0.0, SHOULDER_M))
    parts = shapely.get_parts(shapely.difference(shapely.make_valid(strip), roadside.road.buffer(0.05)))
    return [shapely.get_coordinates(part.exterior)[:-1] for part in parts if part.area > 4.0]
