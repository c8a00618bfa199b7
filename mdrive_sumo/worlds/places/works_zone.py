"""Kind of place: a works zone, where a lane is closed, lanes are narrowed, or both directions share what is left."""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import shapely

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.worlds.places.alignment import (
    buffer_line,
    cut_line,
    draw_bends,
    ease,
    find_point,
    reverse_line,
    shift_line,
    trace_axis,
)
from mdrive_sumo.worlds.places.draft_edge import DraftEdge, DraftLane
from mdrive_sumo.worlds.places.frontage import Roadside, build_box
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Node
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.street_spine import BACKWARD, FORWARD

LAYOUTS = ("lane_closed", "contraflow", "narrowed", "alternating")
END_M = (150.0, 210.0)
"""[m] Range of the road before and behind the zone; chosen: 7 s or more of driving at its limit."""
MEDIAN_M = 3.0
"""[m] Median of a dual carriageway in a town (RASt 06: 2.50 m or more)."""
SHIFT_M = 2.5
"""[m] By how much narrowed lanes lie beside where they were; chosen: it leaves 3 m for the works."""
TRANSITION_M = 30.0
"""[m] In which lanes move aside (RSA 21: 1 m in 10 m at 50 km/h or less)."""
CROSSOVER_M = 60.0
"""[m] In which lanes change the carriageway (there)."""
CLEARANCE_MPS = 30 / 3.6
"""[m/s] Speed by which the time of red for both directions is computed (RiLSA 2015, section 2.7.4: 30 km/h)."""
MARGIN_S = 2
"""[s] Added to the computed time of red for both directions; chosen."""
GREEN_S = 15
"""[s] Of each direction: about seven vehicles at 2 s each; chosen."""
AMBER_S = 3
"""[s] At 50 km/h (RiLSA 2015, section 2.4)."""
ROAD_PRIORITY = 6
"""Priority of all edges for netconvert, of which only the order counts: here there is only one."""
SITE_MARGIN_M = 0.4
"""[m] Between the edge of a lane and what stands on the site; chosen."""
CONTAINER_M = (6.06, 2.44)
"""[m] Length and width of a container of 20 feet (ISO 668)."""
EVERY_M = (9.0, 22.0)
"""[m] Range of the distance of containers and heaps on the site; chosen."""


@dataclass(frozen=True)
class WorksZoneParameters:
    """Parameters of a works zone."""

    layout: str = choose(*LAYOUTS, doc="What the works leave.", weights=(2.0, 1.0, 1.0, 2.0))
    side: str = choose("right", "left", doc="Which lane is closed; for lane_closed only.", weights=(3.0, 1.0))
    limit_kmh: float = choose(50.0, 70.0, 80.0, doc="Speed limit before and behind the zone [km/h].")
    zone_kmh: float = choose(30.0, 50.0, doc="Speed limit of the zone [km/h].")
    lane_m: float = between(3.25, 3.5, doc="Width of a lane before and behind the zone [m] (RASt 06).")
    narrow_m: float = between(2.75, 3.1, doc="Width of a lane of the zone [m] (RSA 21: 2.75 m for lorries).")
    length_m: float = between(50.0, 120.0, doc="Length of the works [m].")
    sinuosity: float = between(0.0, 0.9, doc="Share of the road in bends.")
    roadside: str = choose("open", "hedges", "wood", doc="What stands beside the road.")


@dataclass(frozen=True, eq=False)
class _Zone:
    """Where the zone lies on the axis, and what its layout asks for."""

    axis: Polyline
    begin: float
    end: float
    transition_m: float
    parameters: WorksZoneParameters

    @property
    def is_dual(self) -> bool:
        """Whether the road has two lanes each way and a median."""
        return self.parameters.layout in {"lane_closed", "contraflow"}

    @property
    def inner_m(self) -> float:
        """Distance of the inner edge of both carriageways from the axis."""
        return MEDIAN_M / 2 if self.is_dual else 0.0

    @property
    def outer_m(self) -> float:
        """Distance of their outer edge from the axis."""
        return self.inner_m + (2 if self.is_dual else 1) * self.parameters.lane_m

    def move(self, from_m: float, to_m: float) -> Callable[[float], float]:
        """Return a distance from the axis by station in the zone: it changes to another and back in the transitions."""
        length = self.end - self.begin
        return lambda s: from_m + (to_m - from_m) * ease(min(s, length - s) / self.transition_m)


@dataclass(frozen=True)
class _ZoneLanes:
    """Lanes of a direction in the zone."""

    count: int
    width_m: float
    left_m: float | Callable[[float], float]
    """Distance of the edge nearest to the middle from the axis, to the left; by station if it changes."""


def build_works_zone(draft: NetworkDraft, parameters: WorksZoneParameters, rng: random.Random) -> None:
    """Fill a draft with a works zone."""
    before, behind = rng.uniform(*END_M), rng.uniform(*END_M)
    transition = CROSSOVER_M if parameters.layout == "contraflow" else TRANSITION_M
    end = before + parameters.length_m + 2 * transition
    bends = draw_bends(rng, end + behind, parameters.limit_kmh, parameters.sinuosity, (10.0, 35.0))
    axis = trace_axis((0.0, 0.0), rng.uniform(-math.pi, math.pi), bends)
    zone = _Zone(axis, before, end, transition, parameters)
    for direction in (FORWARD, BACKWARD):
        _add_direction(draft, zone, direction)
    if parameters.layout == "alternating":
        _add_signal(draft, parameters.length_m + 2 * transition)
    site = buffer_line(cut_line(axis, before, end), -zone.inner_m, zone.outer_m)
    draft.paved_areas.append(site)
    roadside = Roadside(draft)
    _add_site(roadside, zone, rng)
    roadside.clear.append(shapely.Polygon(site))
    for kerb in (shift_line(axis, -zone.outer_m), reverse_line(shift_line(axis, zone.outer_m))):
        if parameters.roadside == "hedges":
            roadside.add_hedges(kerb, rng)
        elif parameters.roadside == "wood":
            roadside.add_strip("wood", kerb, 6.0, 8.0, 15.0)


def _add_direction(draft: NetworkDraft, zone: _Zone, direction: str) -> None:
    """Add the edges of a direction before, in and behind the zone, along the axis, with nodes and connections."""
    side = -1.0 if direction == FORWARD else 1.0
    inside, parameters = _place_lanes(zone, direction), zone.parameters
    outside = _ZoneLanes(2 if zone.is_dual else 1, parameters.lane_m, side * zone.inner_m)
    limits = [limit / 3.6 for limit in (parameters.limit_kmh, parameters.zone_kmh, parameters.limit_kmh)]
    if inside.count == 2:
        limits[1] = limits[0]
    stations = (0.0, zone.begin, zone.end, zone.axis.length)
    nodes = _add_nodes(draft, zone, direction, merges=inside.count < outside.count)
    edges: list[DraftEdge] = []
    for k, lanes in enumerate((outside, inside, outside)):
        line = shift_line(cut_line(zone.axis, stations[k], stations[k + 1]), lanes.left_m, 5.0)
        ends = (nodes[k], nodes[k + 1])
        if direction == BACKWARD:
            line, ends = reverse_line(line), (ends[1], ends[0])
        drawn = (DraftLane("drive", lanes.width_m),) * lanes.count
        edges.append(DraftEdge(f"{direction}_{k}", ends[0], ends[1], line, drawn, limits[k], ROAD_PRIORITY))
    draft.edges += edges
    for first, second in pairwise(edges if direction == FORWARD else edges[::-1]):
        counts = len(first.lanes), len(second.lanes)
        pairs = [(min(i, counts[0] - 1), min(i, counts[1] - 1)) for i in range(max(counts))]
        draft.connections += [(first.id, a, second.id, b) for a, b in pairs]


def _place_lanes(zone: _Zone, direction: str) -> _ZoneLanes:
    """Return where the lanes of a direction lie in the zone; the works take the forward side."""
    parameters, inner = zone.parameters, zone.inner_m
    narrow, is_forward = parameters.narrow_m, direction == FORWARD
    match parameters.layout:
        case "lane_closed" if is_forward:
            return _ZoneLanes(1, narrow, -inner - (parameters.lane_m if parameters.side == "left" else 0.0))
        case "lane_closed":
            return _ZoneLanes(2, parameters.lane_m, inner)
        case "contraflow" if is_forward:
            return _ZoneLanes(1, narrow, zone.move(-inner, inner + narrow))
        case "contraflow":
            return _ZoneLanes(1, narrow, inner + parameters.lane_m)
        case "narrowed":
            return _ZoneLanes(1, narrow, zone.move(0.0, SHIFT_M))
        case _:
            return _ZoneLanes(1, narrow, zone.move(0.0, narrow) if is_forward else 0.0)


def _add_nodes(draft: NetworkDraft, zone: _Zone, direction: str, *, merges: bool) -> list[str]:
    """Add the nodes of a direction and return their ids along the axis; on a road of two lanes both share them."""
    ids = ["begin", "zone_begin", "zone_end", "end"]
    shares = not zone.is_dual
    if shares and direction == BACKWARD:
        return ids
    signal = "works" if zone.parameters.layout == "alternating" else ""
    side = 0.0 if shares else -zone.inner_m if direction == FORWARD else zone.inner_m
    ids = ids if shares else [f"{name}_{direction}" for name in ids]
    entry = 1 if direction == FORWARD else 2
    for k, station in enumerate((0.0, zone.begin, zone.end, zone.axis.length)):
        at = find_point(zone.axis, station, side)
        inner_type = "traffic_light" if signal else "zipper" if merges and k == entry else "priority"
        draft.nodes.append(Node(ids[k], *at, inner_type, 1.5, signal) if k in {1, 2} else Node(ids[k], *at))
    return ids


def _add_signal(draft: NetworkDraft, length_m: float) -> None:
    """Add the program of the signal at both ends of the shared lane: one direction at a time, then all red."""
    clearance = math.ceil(length_m / CLEARANCE_MPS) + MARGIN_S
    links = [("forward_0", "forward_1"), ("backward_2", "backward_1"), ("forward_1", "forward_2")]
    links.append(("backward_1", "backward_0"))
    draft.programs.append('<tlLogic id="works" type="static" programID="0" offset="0">')
    for seconds, entries in (
        (GREEN_S, "Gr"), (AMBER_S, "yr"), (clearance, "rr"), (GREEN_S, "rG"), (AMBER_S, "ry"), (clearance, "rr")
    ):  # fmt: skip
        draft.programs.append(f'    <phase duration="{seconds}" state="{entries}GG"/>')
    draft.programs.append("</tlLogic>")
    draft.programs += [
        f'<connection from="{a}" to="{b}" fromLane="0" toLane="0" tl="works" linkIndex="{k}"/>'
        for k, (a, b) in enumerate(links)
    ]


def _add_site(roadside: Roadside, zone: _Zone, rng: random.Random) -> None:
    """Add what stands on the closed part: a barrier at both ends, containers and heaps between them."""
    near, far = _find_site(zone)
    width, centre = far - near - 2 * SITE_MARGIN_M, -(near + far) / 2
    begin, end = zone.begin + zone.transition_m, zone.end - zone.transition_m
    for station in (begin, end):
        roadside.add("barrier", build_box(zone.axis, station, centre, 0.3, width), 0.2)
    station = begin + rng.uniform(4.0, 8.0)
    while station < end - 4.0:
        if rng.random() < 0.5:
            roadside.add("container", build_box(zone.axis, station, centre, *CONTAINER_M), 0.2)
        else:
            heap = rng.uniform(3.0, 6.0), min(width, 3.5)
            roadside.add("heap", build_box(zone.axis, station, centre, *heap), 0.2)
        station += rng.uniform(*EVERY_M)


def _find_site(zone: _Zone) -> tuple[float, float]:
    """Return the distances of the edges of the closed part from the axis, to the right."""
    parameters, inner = zone.parameters, zone.inner_m
    match parameters.layout:
        case "lane_closed" if parameters.side == "right":
            return inner + parameters.narrow_m, zone.outer_m
        case "lane_closed":
            return inner, inner + parameters.lane_m
        case "narrowed":
            return parameters.narrow_m - SHIFT_M, zone.outer_m
        case _:
            return inner, zone.outer_m


WORKS_ZONE = PlaceKind(
    "works_zone",
    "a works zone where a lane is closed, lanes are narrowed, or both directions share what is left",
    WorksZoneParameters,
    build_works_zone,
)
