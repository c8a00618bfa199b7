"""The map of a log becomes a network folder: directions voted, lanes grouped, links rebuilt, compiled and measured."""

import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, polyline
from mdrive_sumo.roads import NetworkFile, RoadMap, load
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, net_checksum
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.network.lane_adjacency import find_beside
from real2sim.network.lane_directions import Directions, turned, vote_directions
from real2sim.network.lane_links import Links, rebuild_links
from real2sim.network.lane_segment import SHORTEST_M, Link, Strip, bounds_width
from real2sim.network.lane_shapes import restore_shapes
from real2sim.network.map_measurements import Fit, measure_fit, observed_speeds, traffic_side
from real2sim.network.network_plan import Edge, Plan, plan_network
from real2sim.network.plain_xml import arguments, compile_plain, lane_places, write_plain
from real2sim.network.segment_splitting import break_strips
from real2sim.network.stop_signs import place_lines, right_of_way, stop_boxes

WIDTH_M = 3.5
WIDTHS_M = (2.0, 6.0)
"""Widths outside are misreadings of the boundaries."""
SPEED_MPS = 13.89
BUILT = (LaneKind.DRIVING, LaneKind.BIKE, LaneKind.SIDEWALK)
CROSSWALK_M = 1.0
"""Crosswalks narrower than this are not drawn."""
WALK_MPS = 2.78


@dataclass(frozen=True)
class NetworkReport:
    """What became of a map, for quality.json."""

    name: str
    folder: Path
    checksum: str
    lanes: int
    """Driving lanes of the source."""
    edges: int
    nodes: int
    connections: int
    left_hand: bool
    directions: Directions
    links_dropped: tuple[Link, ...]
    links_added: tuple[Link, ...]
    lost: Mapping[str, str]
    """Lane of the source -> why it is not in the network."""
    fit: Fit
    """Distance between centre lines, both directions."""
    default_widths: int
    """Lanes of unknown width, which got the distance of their neighbours, or 3.5 m without any."""
    default_speeds: int
    """Lanes of unknown speed limit, which got 13.89 m/s or what was observed."""
    sources: Mapping[str, str]
    """SUMO lane on an edge -> lane of the source that it is, or is a piece of."""
    signalled: tuple[str, ...]
    """Lanes that traffic lights control. The network has no lights: the log does not tell their program."""


def build_network(map: HdMap, motions: Sequence[Float], folder: Path, name: str, dt_s: float = 0.1) -> NetworkReport:
    """Builds `folder` (plain XML, network.json, map.net.xml.gz) from a map; raises InputError.

    `motions` are observed x, y, yaw (N, 3) [m, rad] of vehicles, a row every `dt_s`; NaN where unseen.
    """
    drawn = _drawable(map, name)
    directions = vote_directions(drawn, motions)
    lanes = {id_: turned(lane) if id_ in directions.inverted else lane for id_, lane in drawn.items()}
    decided = {id_: lane for id_, lane in lanes.items() if id_ not in directions.undecided}
    left_hand = map.left_hand if map.left_hand is not None else traffic_side(decided, directions.voted)
    strips, lost = _strips(map, lanes, observed_speeds(lanes, motions, dt_s))
    links = rebuild_links(strips, _said(lanes))
    plan = plan_network(*_driving_only(strips, links))
    lane_ids = {id_: f"{edge}_{k}" for id_, (edge, k) in lane_places(plan, left_hand).items()}
    roads = _compile(_with_footways(plan, strips, map), map, left_hand, folder, name)
    lost |= dict.fromkeys(_unused(plan), "no way through the junction uses it")
    return NetworkReport(
        name=name,
        folder=folder,
        checksum=roads.checksum,
        lanes=sum(lane.kind is LaneKind.DRIVING for lane in map.lanes.values()),
        edges=len(plan.edges),
        nodes=len({node for edge in plan.edges for node in (edge.begin, edge.end)}),
        connections=len(plan.ways),
        left_hand=left_hand,
        directions=directions,
        links_dropped=links.dropped,
        links_added=links.added,
        lost=lost,
        fit=measure_fit([s.line for s in strips.values() if s.kind is LaneKind.DRIVING], roads),
        default_widths=sum(_width(lane) is None for lane in lanes.values()),
        default_speeds=sum(not lane.speed_limit > 0 for lane in lanes.values()),
        sources={lane_ids[lane.id]: lane.lane for edge in plan.edges for lane in edge.lanes},
        signalled=tuple(sorted({lane for controlled in map.signals.values() for lane in controlled})),
    )


def _drawable(map: HdMap, name: str) -> dict[str, MapLane]:
    """Lanes long enough to drive on; raises InputError for broken coordinates or a map without driving lanes."""
    for id_, lane in map.lanes.items():
        if lane.centre.ndim != 2 or lane.centre.shape[1:] != (2,) or not np.isfinite(lane.centre).all():
            raise InputError(f"map of {name}: lane {id_}: expected finite points (N, 2), found {lane.centre.shape}")
    lanes = {
        id_: replace(lane, centre=polyline(lane.centre).xy)
        for id_, lane in map.lanes.items()
        if len(lane.centre) > 1 and np.hypot(*np.diff(lane.centre, axis=0).T).sum() >= SHORTEST_M
    }
    if not any(lane.kind is LaneKind.DRIVING for lane in lanes.values()):
        raise InputError(f"map of {name}: expected at least one driving lane, found none in {len(map.lanes)} lanes")
    return lanes


def _said(lanes: Mapping[str, MapLane]) -> set[Link]:
    return {(id_, exit_) for id_, lane in lanes.items() for exit_ in lane.exits} | {
        (entry, id_) for id_, lane in lanes.items() for entry in lane.entries
    }


def _strips(
    map: HdMap, lanes: Mapping[str, MapLane], seen: Mapping[str, float]
) -> tuple[dict[str, Strip], dict[str, str]]:
    lost = {id_: f"shorter than {SHORTEST_M} m" for id_ in map.lanes if id_ not in lanes}
    strips: dict[str, Strip] = {}
    for id_, lane in lanes.items():
        if lane.kind not in BUILT:
            lost[id_] = f"a {lane.kind} lane, not for driving"
            continue
        limit = lane.speed_limit if lane.speed_limit > 0 else max(SPEED_MPS, seen.get(id_, 0.0))
        width = _width(lane) or float("nan")
        strips[id_] = Strip(id_, id_, polyline(lane.centre), width, limit, lane.kind, lane.junction, lane.group)
    return _with_widths(strips), lost


def _width(lane: MapLane) -> float | None:
    for width in (lane.width, bounds_width(lane)):
        if WIDTHS_M[0] <= width <= WIDTHS_M[1]:
            return width
    return None


def _with_widths(strips: Mapping[str, Strip]) -> dict[str, Strip]:
    """Unknown widths from the spacing of neighbours, else the default."""
    if not any(np.isnan(strip.width) for strip in strips.values()):
        return dict(strips)
    spacing: dict[str, list[float]] = {}
    for beside in find_beside(strips):
        if abs(beside.offset) >= 2.5:
            spacing.setdefault(beside.strip, []).append(abs(beside.offset))
    return {
        id_: strip
        if not np.isnan(strip.width)
        else replace(strip, width=min(float(np.median(spacing.get(id_, [WIDTH_M]))), 4.5))
        for id_, strip in strips.items()
    }


def _driving_only(strips: Mapping[str, Strip], links: Links) -> tuple[dict[str, Strip], set[Link]]:
    driving = {id_: strip for id_, strip in strips.items() if strip.kind is LaneKind.DRIVING}
    return break_strips(driving, {(a, b) for a, b in links.links if a in driving and b in driving})


def _with_footways(plan: Plan, strips: Mapping[str, Strip], map: HdMap) -> Plan:
    """Bicycle lanes, pavements and crosswalks as edges of their own that lead nowhere: for pictures and walkers."""
    drawn = [strip for strip in strips.values() if strip.kind is not LaneKind.DRIVING]
    drawn += [strip for k, outline in enumerate(map.crosswalks) if (strip := _crosswalk(k, outline)) is not None]
    first = 1 + max((node for edge in plan.edges for node in (edge.begin, edge.end)), default=-1)
    edges = [Edge((strip,), first + 2 * k, first + 2 * k + 1) for k, strip in enumerate(drawn)]
    return replace(plan, edges=(*plan.edges, *edges))


def _crosswalk(number: int, outline: Float) -> Strip | None:
    """A strip along the longer axis of the smallest rectangle around the crosswalk."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.MultiPoint(outline)))
    if len(corners) < 4:
        return None
    ends, others = (corners[:2] + corners[[3, 2]]) / 2, (corners[1:3] + corners[[0, 3]]) / 2
    if np.hypot(*(ends[1] - ends[0])) < np.hypot(*(others[1] - others[0])):
        ends, others = others, ends
    width = float(np.hypot(*(others[1] - others[0])))
    if width < CROSSWALK_M:
        return None
    name = f"crosswalk_{number}"
    return Strip(name, name, polyline(ends), width, WALK_MPS, LaneKind.SIDEWALK, False)


def _compile(plan: Plan, map: HdMap, left_hand: bool, folder: Path, name: str) -> RoadMap:
    folder.mkdir(parents=True, exist_ok=True)
    stops = place_lines(plan, map)
    write_plain(plan, *right_of_way(plan, stops), left_hand, folder)
    lane_ids = {id_: f"{edge}_{k}" for id_, (edge, k) in lane_places(plan, left_hand).items()}
    xml = restore_shapes(compile_plain(folder, left_hand), plan, lane_ids)
    (folder / NET_FILE).write_bytes(gzip.compress(xml, mtime=0))
    about = NetworkFile(
        name=name,
        description="Built from the map of a log",
        origin=f"map of {name}",
        licence="that of the log",
        offset=(0.0, 0.0),
        build=("netconvert", *arguments(left_hand), "--output-file", "map.net.xml"),
        checksum=net_checksum(xml),
        stop_signs=stop_boxes(stops, lane_ids) if map.stop_lines else None,
    )
    (folder / NETWORK_FILE).write_text(about.model_dump_json(indent=1) + "\n")
    load.cache_clear()  # it may remember another network that lay in this folder
    return load(folder)


def _unused(plan: Plan) -> set[str]:
    kept = {lane.lane for edge in plan.edges for lane in edge.lanes}
    kept |= {id_.split("~")[0] for way in plan.ways for id_ in way.strips}
    return {id_.split("~")[0] for id_ in plan.unused} - kept
