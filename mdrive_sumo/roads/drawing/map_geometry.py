"""Compute the geometry of a network's picture once, for plots, the replay page and the conversion report."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float, build_polyline
from mdrive_sumo.roads import Lane, RoadMap, StopSignBox
from mdrive_sumo.roads.drawing.lane_markings import LaneMarkings, compute_lane_markings

SEAM_M = 0.05
"""[m] Surfaces are drawn larger by this much, so that no seam shows between them."""
CLOSING_M = 0.6
"""[m] Gaps between lanes up to twice this width are filled with asphalt."""
SPIKE_M = 0.3
"""[m] Tongues of asphalt up to twice this width are left out."""
MIN_ISLAND_M2 = 12.0
"""[m²] Smaller holes in the asphalt are filled."""
TOLERANCE_M = 0.03
"""[m] Precision of the asphalt's edge."""
KNOWN_SHARE = 0.7
"""Where drivable areas cover this share of a junction, they show its kerbs better than netconvert's outline."""
INSIDE_M = 0.3
"""[m] Markings may reach this far into a junction."""
SIGN_OFFSET_M = 2.2
"""[m] Distance of a stop sign from the lane's edge."""


@dataclass(frozen=True)
class StopMark:
    """A stop line across a lane (2, 2) [m], from left to right, and the position (2,) of a sign beside it."""

    line: Float
    sign: Float | None
    """None: a traffic light, or a lane with another one between it and the kerb."""


@dataclass(frozen=True)
class SignalHead:
    """The traffic lights at the end of a lane."""

    place: Float
    """(2,) [m]"""
    yaw: float
    """Driving direction there [rad]."""
    width: float
    """Width of the lane [m]."""
    lights: tuple[str, ...]
    """Names "tls:index", from left to right."""


@dataclass(frozen=True)
class MapGeometry:
    """What a picture of a network shows, from bottom to top [m]."""

    pavements: tuple[shapely.Polygon, ...]
    aprons: tuple[shapely.Polygon, ...]
    """Drivable areas beside the lanes: parking lanes, car parks, driveways."""
    asphalt: tuple[shapely.Polygon, ...]
    stripes: tuple[shapely.Polygon, ...]
    """Stripes of pedestrian crossings."""
    markings: LaneMarkings
    stop_signs: tuple[StopMark, ...]
    light_stops: tuple[StopMark, ...]
    """Stop lines of traffic lights."""
    buildings: tuple[shapely.Polygon, ...]


def build_map_geometry(roads: RoadMap, area: BaseGeometry) -> MapGeometry:
    """Return everything of a network that touches an area."""
    return _build_map_geometry(roads, shapely.to_wkb(area))


@lru_cache(maxsize=16)  # a tenth of a second, and plot, replay and film of an episode show the same area
def _build_map_geometry(roads: RoadMap, wkb: bytes) -> MapGeometry:
    area = shapely.from_wkb(wkb)
    shapely.prepare(area)
    lanes = [lane for lane in roads.driving if area.intersects(shapely.LineString(lane.centre.xy))]
    drivable = shapely.union_all([part for one in roads.drivable_areas if area.intersects(part := one.polygon)])
    outlines = (make_polygon(outline).buffer(SEAM_M) for outline in roads.junctions)
    junctions = [outline for outline in outlines if area.intersects(outline)]
    asphalt = _build_asphalt(lanes, [_fit_junction(outline, drivable) for outline in junctions])
    bare = shapely.union_all([*junctions, *(_build_strip(lane) for lane in lanes if lane.junction)])
    aprons = _open(shapely.difference(drivable, asphalt), 2 * SEAM_M).buffer(SEAM_M, quad_segs=2)
    crosswalks = set(roads.crosswalk_pavements)
    walks = (make_polygon(outline) for i, outline in enumerate(roads.pavements) if i not in crosswalks)
    return MapGeometry(
        pavements=_list_polygons(walk for walk in walks if area.intersects(walk)),
        aprons=_list_polygons([aprons]),
        asphalt=_list_polygons([asphalt]),
        stripes=tuple(clip_stripes(_build_stripes(roads, area, lanes), shapely.union(asphalt, drivable))),
        markings=compute_lane_markings([lane for lane in lanes if not lane.junction], bare.buffer(-INSIDE_M), asphalt),
        stop_signs=tuple(_build_stop_signs(roads, lanes)),
        light_stops=tuple(StopMark(_cross(lane, lane.centre.length), None) for lane in lanes if lane.lights),
        buildings=tuple(shape for shape in roads.building_shapes if area.intersects(shape)),
    )


def list_signal_heads(roads: RoadMap, area: BaseGeometry) -> list[SignalHead]:
    """Return the traffic lights of all lanes that end in an area."""
    return [
        SignalHead(
            lane.centre.xy[-1],
            lane.centre.yaw_at(lane.centre.length),
            lane.width,
            tuple(dict.fromkeys(lane.lights.values())),
        )
        for lane in roads.driving
        if lane.lights and shapely.intersects(area, shapely.Point(lane.centre.xy[-1]))
    ]


def make_polygon(outline: Float) -> BaseGeometry:
    """Return the valid area within an outline (N, 2), which may cross itself."""
    return shapely.make_valid(shapely.Polygon(outline))


def _list_polygons(shapes: Iterable[BaseGeometry]) -> tuple[shapely.Polygon, ...]:
    return tuple(
        part
        for shape in shapes
        for part in shapely.get_parts(shape).tolist()
        if isinstance(part, shapely.Polygon) and not part.is_empty
    )


def _build_strip(lane: Lane) -> BaseGeometry:
    return shapely.LineString(lane.centre.xy).buffer(lane.width / 2 + SEAM_M, cap_style="flat")


def _fit_junction(outline: BaseGeometry, drivable: BaseGeometry) -> BaseGeometry:
    """Return a junction up to the edge of the drivable area if that is known there."""
    is_known = shapely.intersection(outline, drivable).area >= KNOWN_SHARE * outline.area
    return shapely.intersection(outline.convex_hull, drivable) if is_known else outline


def _build_asphalt(lanes: Sequence[Lane], junctions: Sequence[BaseGeometry]) -> BaseGeometry:
    whole = shapely.union_all([*(_build_strip(lane) for lane in lanes), *junctions])
    closed = whole.buffer(CLOSING_M, quad_segs=4).buffer(-CLOSING_M, quad_segs=4)
    opened = _open(shapely.union(whole, closed), SPIKE_M)
    return shapely.union_all([_fill_islands(part) for part in _list_polygons([opened])]).simplify(TOLERANCE_M)


def _open(shape: BaseGeometry, half_width: float) -> BaseGeometry:
    """Return a shape without parts narrower than twice the half width [m]."""
    return shape.buffer(-half_width, quad_segs=4).buffer(half_width, quad_segs=4)


def _fill_islands(part: shapely.Polygon) -> shapely.Polygon:
    islands = [ring for ring in part.interiors if shapely.Polygon(ring).area >= MIN_ISLAND_M2]
    return shapely.Polygon(part.exterior, islands)


def _build_stripes(roads: RoadMap, area: BaseGeometry, lanes: Sequence[Lane]) -> list[shapely.Polygon]:
    crossings = [(line, width) for line, width in roads.crossings if area.intersects(shapely.LineString(line))]
    outlines = [roads.pavements[i] for i in roads.crosswalk_pavements]
    lines = (find_walking_line(outline, lanes) for outline in outlines if area.intersects(make_polygon(outline)))
    return [
        stripe
        for line, width in (*crossings, *(one for one in lines if one is not None))
        for stripe in build_crossing_stripes(line, width)
    ]


def _build_stop_signs(roads: RoadMap, lanes: Sequence[Lane]) -> Iterator[StopMark]:
    near = {lane.id for lane in lanes}
    signs = [sign for sign in roads.stop_signs or () if sign.lane in near]
    signed = {sign.lane for sign in signs}
    for sign in signs:
        yield _build_stop_mark(roads.lanes[sign.lane], sign, roads.lanes[sign.lane].right not in signed)


def _build_stop_mark(lane: Lane, sign: StopSignBox, is_outer: bool) -> StopMark:
    line = _cross(lane, sign.line_pos_m)
    outward = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
    return StopMark(line, line[1] + outward * SIGN_OFFSET_M if is_outer else None)


def _cross(lane: Lane, s: float) -> Float:
    """Return the line (2, 2) [m] across a lane from left to right."""
    yaw = lane.centre.yaw_at(max(s - 0.1, 0.0))
    right = np.array((np.sin(yaw), -np.cos(yaw))) * max(lane.width / 2 - 0.2, 0.1)
    centre = np.array(lane.centre.at(s))
    return np.array((centre - right, centre + right))


PERIOD_M, STRIPE_M = 1.0, 0.5
"""[m] Distance between the middles of stripes, and their width."""
MIN_SHARE = 0.4
"""Stripes with a smaller share on asphalt are left out: they would lie on the kerb or beside the road."""


def build_crossing_stripes(line: Float, width: float) -> list[shapely.Polygon]:
    """Return the stripes of a crossing with a centre line (N, 2) and a width [m]."""
    centre = build_polyline(line)
    margin = (centre.length % PERIOD_M + PERIOD_M - STRIPE_M) / 2
    starts = np.arange(margin, centre.length - STRIPE_M + 1e-6, PERIOD_M)
    return [
        _build_stripe(np.array(centre.at(s + STRIPE_M / 2)), centre.yaw_at(s + STRIPE_M / 2), width) for s in starts
    ]


def _build_stripe(middle: Float, yaw: float, width: float) -> shapely.Polygon:
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    half, side = ahead * STRIPE_M / 2, left * width / 2
    return shapely.Polygon((middle + half + side, middle - half + side, middle - half - side, middle + half - side))


def find_walking_line(outline: Float, lanes: Sequence[Lane]) -> tuple[Float, float] | None:
    """Return centre line (2, 2) and width [m] of the rectangle around a crosswalk (N, 2); None if it has no area.

    People walk across the lanes below the crosswalk; without a lane, along its longer side.
    """
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.MultiPoint(outline)))
    if len(corners) < 4:
        return None
    pairs = [((corners[0] + corners[3]) / 2, (corners[1] + corners[2]) / 2)]
    pairs.append(((corners[0] + corners[1]) / 2, (corners[2] + corners[3]) / 2))
    lines = [np.array(pair) for pair in pairs]
    lengths = [float(np.hypot(*(line[1] - line[0]))) for line in lines]
    along = [_measure_traffic_along(outline, line, lanes) for line in lines]
    chosen = int(np.argmin(along)) if abs(along[0] - along[1]) > 0.1 * max(along) else int(np.argmax(lengths))
    return (lines[chosen], lengths[1 - chosen]) if min(lengths) > 0 else None


def _measure_traffic_along(outline: Float, line: Float, lanes: Sequence[Lane]) -> float:
    """Return the length [m] of lanes within a crosswalk, projected onto the direction of a line (2, 2)."""
    ahead = (line[1] - line[0]) / max(float(np.hypot(*(line[1] - line[0]))), 1e-9)
    area = shapely.MultiPoint(outline).convex_hull
    steps = [np.diff(xy, axis=0) @ ahead for lane in lanes for xy in _clip_line(lane.centre.xy, area)]
    return float(np.abs(np.concatenate(steps)).sum()) if steps else 0.0


def _clip_line(xy: Float, area: BaseGeometry) -> Iterator[Float]:
    for part in shapely.get_parts(shapely.intersection(shapely.LineString(xy), area)).tolist():
        if isinstance(part, shapely.LineString):
            yield shapely.get_coordinates(part)


def clip_stripes(stripes: Sequence[shapely.Polygon], asphalt: BaseGeometry) -> Iterator[shapely.Polygon]:
    """Yield the parts of stripes that lie on asphalt, without stripes of which little does."""
    shapely.prepare(asphalt)
    for stripe in stripes:
        part = stripe if asphalt.contains(stripe) else shapely.intersection(stripe, asphalt)
        if part.area >= MIN_SHARE * stripe.area:
            yield from (one for one in shapely.get_parts(part).tolist() if isinstance(one, shapely.Polygon))
