"""Build a network folder from the map of a log: directions, segments, links, edges, compilation, measurements."""

import gzip
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.core.output_files import make_folder, write_bytes, write_text
from mdrive_sumo.roads import NetworkFile, RoadMap, load_road_map
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, Building, compute_net_checksum
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.network.drivable_areas import collect_drivable_areas
from real2sim.network.lane_adjacency import find_adjacencies
from real2sim.network.lane_directions import LaneDirections, reverse_lane, vote_directions
from real2sim.network.lane_links import RebuiltLinks, rebuild_links
from real2sim.network.lane_segment import MIN_LANE_M, LaneLink, LaneSegment, measure_boundary_width
from real2sim.network.map_measurements import (
    MapDeviation,
    is_left_hand_traffic,
    measure_centreline_deviation,
    measure_observed_speeds,
)
from real2sim.network.network_plan import NetworkPlan, PlannedEdge, plan_network
from real2sim.network.plain_xml import (
    assign_lane_indices,
    build_plain_arguments,
    compile_plain,
    restore_shapes,
    write_plain,
)
from real2sim.network.segment_splitting import split_at_neighbours
from real2sim.network.stop_signs import build_stop_boxes, derive_right_of_way, place_stop_lines

DEFAULT_LANE_WIDTH_M = 3.5
"""[m] A usual lane, where neither the map nor the neighbours tell the width."""
PLAUSIBLE_WIDTHS_M = (2.0, 6.0)
"""[m] Widths outside are errors of the boundaries."""
DEFAULT_SPEED_MPS = 13.89
"""[m/s] 50 km/h, where the map has no limit and the log shows no higher speed."""
BUILT_LANE_KINDS = (LaneKind.DRIVING, LaneKind.BIKE, LaneKind.SIDEWALK)
MIN_CROSSWALK_M = 1.0
"""[m] Narrower crosswalks are not drawn."""
FOOTWAY_MPS = 2.78
"""[m/s] 10 km/h: no vehicle of a log is routed over a footway."""


@dataclass(frozen=True)
class NetworkReport:
    """Result of building a network, for quality.json."""

    name: str
    folder: Path
    checksum: str
    lanes: int
    """Number of driving lanes of the source."""
    edges: int
    nodes: int
    connections: int
    left_hand: bool
    directions: LaneDirections
    links_dropped: tuple[LaneLink, ...]
    links_added: tuple[LaneLink, ...]
    drop_reason_by_lane: Mapping[str, str]
    """Lane of the source -> why it, or the stated part of it, is not in the network."""
    lost_in_part: frozenset[str]
    """The lanes of `drop_reason_by_lane` of which a part is in the network."""
    lost_m_by_lane: Mapping[str, float]
    """Driving lane of the source -> how much of it [m] the plan of the network leaves out."""
    deviation: MapDeviation
    """Distance between centre lines in both directions, without the parts that run against other lanes and are left
    out."""
    default_widths: int
    """Number of lanes of unknown width: they get the spacing of their neighbours, else 3.5 m."""
    default_speeds: int
    """Number of lanes of unknown speed limit: they get 13.89 m/s or the observed speed."""
    source_by_lane: Mapping[str, str]
    """SUMO lane on an edge -> lane of the source."""
    signalled: tuple[str, ...]
    """Lanes controlled by traffic lights. The network has no lights because the log does not contain their program."""


def build_network(
    map: HdMap,
    motions: Sequence[Float],
    folder: Path,
    name: str,
    dt_s: float = 0.1,
    origin: tuple[float, float] = (0.0, 0.0),
) -> NetworkReport:
    """Build `folder` (plain XML, network.json, map.net.xml.gz) from a map; raise InputError.

    `motions` are observed x, y, yaw (N, 3) [m, rad] of vehicles, one row every `dt_s`; NaN where not observed.
    `origin`: that of the map's frame in the frame of the source [m], for `network.json`.
    """
    drawn = _select_drawable_lanes(map, name)
    directions = vote_directions(drawn, motions)
    lanes = {id_: reverse_lane(lane) if id_ in directions.inverted else lane for id_, lane in drawn.items()}
    decided = {id_: lane for id_, lane in lanes.items() if id_ not in directions.undecided}
    left_hand = map.left_hand if map.left_hand is not None else is_left_hand_traffic(decided, directions.votes)
    segments, lost = _build_segments(map, lanes, measure_observed_speeds(lanes, motions, dt_s))
    links = rebuild_links(segments, _collect_source_links(lanes))
    parts, part_links = _select_driving(segments, links)
    plan = plan_network(parts, part_links, directions.votes)
    lane_ids = {id_: lane.lane_id for id_, lane in assign_lane_indices(plan, left_hand).items()}
    roads = _compile_network(_add_footways(plan, segments, map), map, left_hand, folder, NetworkName(name, origin))
    unused = _sum_lengths(plan.unused)
    contraflow = _sum_lengths([parts[id_] for id_ in plan.contraflow])
    lost |= _explain_lost(segments, unused, "no way through the junction uses it")
    lost |= _explain_lost(segments, contraflow, "it leads nowhere but onto a lane of the opposite direction")
    return NetworkReport(
        name=name,
        folder=folder,
        checksum=roads.checksum,
        lanes=sum(lane.kind is LaneKind.DRIVING for lane in map.lanes.values()),
        edges=len(plan.edges),
        nodes=len({node for edge in plan.edges for node in (edge.begin, edge.end)}),
        connections=len(plan.connections),
        left_hand=left_hand,
        directions=directions,
        links_dropped=links.dropped,
        links_added=links.added,
        drop_reason_by_lane=lost,
        lost_in_part=_find_lost_in_part(segments, unused, contraflow),
        lost_m_by_lane={id_: round(unused.get(id_, 0.0) + contraflow.get(id_, 0.0), 1) for id_ in unused | contraflow},
        deviation=measure_centreline_deviation(_select_centrelines(segments, parts, plan), roads),
        default_widths=sum(_measure_width(lane) is None for lane in lanes.values()),
        default_speeds=sum(not lane.speed_limit > 0 for lane in lanes.values()),
        source_by_lane={lane_ids[lane.id]: lane.source_lane for edge in plan.edges for lane in edge.lanes},
        signalled=tuple(sorted({lane for controlled in map.signals.values() for lane in controlled})),
    )


def _select_drawable_lanes(map: HdMap, name: str) -> dict[str, MapLane]:
    """Return lanes long enough to drive on; raise InputError for invalid coordinates or a map without driving lanes."""
    for id_, lane in map.lanes.items():
        if lane.centre.ndim != 2 or lane.centre.shape[1:] != (2,) or not np.isfinite(lane.centre).all():
            raise InputError(f"map of {name}: lane {id_}: expected finite points (N, 2), found {lane.centre.shape}")
    lanes = {
        id_: replace(lane, centre=build_polyline(lane.centre).xy)
        for id_, lane in map.lanes.items()
        if len(lane.centre) > 1 and np.hypot(*np.diff(lane.centre, axis=0).T).sum() >= MIN_LANE_M
    }
    if not any(lane.kind is LaneKind.DRIVING for lane in lanes.values()):
        raise InputError(f"map of {name}: expected at least one driving lane, found none in {len(map.lanes)} lanes")
    return lanes


def _collect_source_links(lanes: Mapping[str, MapLane]) -> set[LaneLink]:
    return {(id_, exit_) for id_, lane in lanes.items() for exit_ in lane.exits} | {
        (entry, id_) for id_, lane in lanes.items() for entry in lane.entries
    }


def _build_segments(
    map: HdMap, lanes: Mapping[str, MapLane], seen: Mapping[str, float]
) -> tuple[dict[str, LaneSegment], dict[str, str]]:
    lost = {id_: f"shorter than {MIN_LANE_M} m" for id_ in map.lanes if id_ not in lanes}
    segments: dict[str, LaneSegment] = {}
    for id_, lane in lanes.items():
        if lane.kind not in BUILT_LANE_KINDS:
            lost[id_] = f"a {lane.kind} lane, not for driving"
            continue
        limit = lane.speed_limit if lane.speed_limit > 0 else max(DEFAULT_SPEED_MPS, seen.get(id_, 0.0))
        width = _measure_width(lane) or float("nan")
        segments[id_] = LaneSegment(
            id_, id_, build_polyline(lane.centre), width, limit, lane.kind, lane.junction, lane.group
        )
    return _fill_widths(segments), lost


def _measure_width(lane: MapLane) -> float | None:
    for width in (lane.width, measure_boundary_width(lane)):
        if PLAUSIBLE_WIDTHS_M[0] <= width <= PLAUSIBLE_WIDTHS_M[1]:
            return width
    return None


def _fill_widths(segments: Mapping[str, LaneSegment]) -> dict[str, LaneSegment]:
    """Fill unknown widths from the spacing of neighbours, else with the default."""
    if not any(np.isnan(segment.width) for segment in segments.values()):
        return dict(segments)
    spacing: dict[str, list[float]] = {}
    for adjacency in find_adjacencies(segments):
        if abs(adjacency.offset) >= 2.5:
            spacing.setdefault(adjacency.segment, []).append(abs(adjacency.offset))
    return {
        id_: segment
        if not np.isnan(segment.width)
        else replace(segment, width=min(float(np.median(spacing.get(id_, [DEFAULT_LANE_WIDTH_M]))), 4.5))
        for id_, segment in segments.items()
    }


def _select_driving(
    segments: Mapping[str, LaneSegment], links: RebuiltLinks
) -> tuple[dict[str, LaneSegment], set[LaneLink]]:
    driving = {id_: segment for id_, segment in segments.items() if segment.kind is LaneKind.DRIVING}
    return split_at_neighbours(driving, {(a, b) for a, b in links.links if a in driving and b in driving})


def _add_footways(plan: NetworkPlan, segments: Mapping[str, LaneSegment], map: HdMap) -> NetworkPlan:
    """Add bicycle lanes, pavements and crosswalks as unconnected edges, for display and pedestrians."""
    drawn = [segment for segment in segments.values() if segment.kind is not LaneKind.DRIVING]
    drawn += [
        segment for k, outline in enumerate(map.crosswalks) if (segment := _build_crosswalk(k, outline)) is not None
    ]
    first = 1 + max((node for edge in plan.edges for node in (edge.begin, edge.end)), default=-1)
    edges = [PlannedEdge((segment,), first + 2 * k, first + 2 * k + 1) for k, segment in enumerate(drawn)]
    return replace(plan, edges=(*plan.edges, *edges))


def _build_crosswalk(number: int, outline: Float) -> LaneSegment | None:
    """Return a segment along the longer axis of the minimum rectangle around the crosswalk."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.MultiPoint(outline)))
    if len(corners) < 4:
        return None
    ends, others = (corners[:2] + corners[[3, 2]]) / 2, (corners[1:3] + corners[[0, 3]]) / 2
    if np.hypot(*(ends[1] - ends[0])) < np.hypot(*(others[1] - others[0])):
        ends, others = others, ends
    width = float(np.hypot(*(others[1] - others[0])))
    if width < MIN_CROSSWALK_M:
        return None
    name = f"crosswalk_{number}"
    return LaneSegment(name, name, build_polyline(ends), width, FOOTWAY_MPS, LaneKind.SIDEWALK, False)


@dataclass(frozen=True)
class NetworkName:
    """What network.json says about a network besides its content."""

    name: str
    origin: tuple[float, float]


def _compile_network(plan: NetworkPlan, map: HdMap, left_hand: bool, folder: Path, called: NetworkName) -> RoadMap:
    make_folder(folder)
    stops = place_stop_lines(plan, map)
    write_plain(plan, *derive_right_of_way(plan, stops), left_hand, folder)
    lane_ids = {id_: lane.lane_id for id_, lane in assign_lane_indices(plan, left_hand).items()}
    xml = restore_shapes(compile_plain(folder, left_hand), plan, lane_ids)
    write_bytes(folder / NET_FILE, gzip.compress(xml, mtime=0))
    about = NetworkFile(
        name=called.name,
        description="Built from the map of a log",
        origin=f"map of {called.name}",
        licence="that of the log",
        offset=(0.0 - called.origin[0], 0.0 - called.origin[1]),
        log_origin=called.origin if any(called.origin) else None,
        build=("netconvert", *build_plain_arguments(left_hand), "--output-file", "map.net.xml"),
        checksum=compute_net_checksum(xml),
        stop_signs=build_stop_boxes(stops, lane_ids) if map.stop_lines else None,
        buildings=_build_buildings(map),
        drivable_areas=collect_drivable_areas(map),
    )
    write_text(folder / NETWORK_FILE, about.model_dump_json(indent=1) + "\n")
    load_road_map.cache_clear()  # the folder may have held another network
    return load_road_map(folder)


def _build_buildings(map: HdMap) -> tuple[Building, ...]:
    return tuple(
        Building(id=f"building_{number}", polygon=tuple((round(x, 2), round(y, 2)) for x, y in area.outline.tolist()))
        for number, area in enumerate(map.buildings)
    )


def _sum_lengths(segments: Iterable[LaneSegment]) -> dict[str, float]:
    """Return the length [m] of the segments by lane of the source."""
    lengths: dict[str, float] = {}
    for segment in segments:
        lengths[segment.source_lane] = lengths.get(segment.source_lane, 0.0) + segment.centreline.length
    return lengths


def _find_lost_in_part(segments: Mapping[str, LaneSegment], *lost_m: Mapping[str, float]) -> frozenset[str]:
    """Return the lanes that are left out, but for more than `MIN_LANE_M`."""
    lengths = {id_: sum(lost.get(id_, 0.0) for lost in lost_m) for lost in lost_m for id_ in lost}
    return frozenset(id_ for id_, length in lengths.items() if segments[id_].centreline.length - length > MIN_LANE_M)


def _explain_lost(segments: Mapping[str, LaneSegment], lost_m: Mapping[str, float], why: str) -> dict[str, str]:
    """Return the reason by lane, with the metres of the lanes that are lost in part."""
    reasons: dict[str, str] = {}
    for id_, length in sorted(lost_m.items()):
        whole = segments[id_].centreline.length
        is_part = whole - length > MIN_LANE_M
        reasons[id_] = f"{length:.1f} of its {whole:.1f} m: {why}" if is_part else why
    return reasons


def _select_centrelines(
    segments: Mapping[str, LaneSegment], parts: Mapping[str, LaneSegment], plan: NetworkPlan
) -> list[Polyline]:
    """Return the centre lines that the network should have: of lanes that are left out in part, the rest.

    Where a lane runs against another one there is nothing to compare: only the other one is in the network.
    """
    left_out = set(plan.contraflow)
    affected = {parts[id_].source_lane for id_ in left_out}
    whole = [s.centreline for s in segments.values() if s.kind is LaneKind.DRIVING and s.id not in affected]
    return whole + [s.centreline for s in parts.values() if s.source_lane in affected and s.id not in left_out]
