"""Collect the asphalt beyond the lanes of a log: drivable areas of its map, and where its vehicles drive and park.

Pictures need it: without it parked cars stand in a meadow. Simulation and scoring do not read it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import DrivableArea
from real2sim.hd_map import HdMap, LaneKind, MapArea, MapLane
from real2sim.readers.map_geometry import split_areas
from real2sim.recording import DEFAULT_SIZE_M, RecordedTrack

WIDTH_M: Mapping[LaneKind, float] = {LaneKind.BIKE: 1.8, LaneKind.SHOULDER: 2.5, LaneKind.PARKING: 2.5}
"""[m] Width of lanes that vehicles stand on but do not drive on, where the source gives none."""
LANE_WIDTH_M = 3.5
"""[m] Width of driving lanes where the source gives none."""
ASPHALT_MARGIN_M = 0.6
"""[m] Asphalt around a vehicle of the log."""
CLOSING_M = 2.5
"""[m] Vehicles up to twice this apart stand on one area."""
SLIVER_M = 0.3
"""[m] Strips up to twice this width beside known asphalt come from imprecise maps and tracks."""
MAP_AREA_RANGE_M = 40.0
"""[m] Areas of the map farther from all lanes are left out: nuScenes gives those of half a city."""
MIN_CORE_M2 = 1.0
"""[m²] Areas that are smaller without a strip of `SLIVER_M` come from imprecise maps and tracks as well."""
TOLERANCE_M, GRID_M = 0.1, 0.01
"""[m] Precision of outlines in network.json."""


def add_observed_areas(map: HdMap, tracks: Iterable[RecordedTrack]) -> HdMap:
    """Return the map with the areas on which vehicles of the log drive or stand beyond the map's lanes and areas."""
    vehicles = [track for track in tracks if track.category.kind is Kind.VEHICLE and track.valid.any()]
    driven = shapely.union_all([_build_swept_area(track) for track in vehicles])
    observed = driven.buffer(CLOSING_M).buffer(-CLOSING_M)
    lanes = [_build_lane_area(lane) for lane in map.lanes.values() if lane.kind is not LaneKind.SIDEWALK]
    mapped = shapely.union_all([*lanes, *(_to_polygon(area) for area in map.drivable_areas)])
    beyond = shapely.difference(observed, mapped)
    cores = [part for part in shapely.get_parts(beyond.buffer(-SLIVER_M)).tolist() if part.area >= MIN_CORE_M2]
    areas = shapely.intersection(shapely.union_all(cores).buffer(SLIVER_M + ASPHALT_MARGIN_M), observed)
    return replace(map, observed_areas=split_areas(areas))


def _build_swept_area(track: RecordedTrack) -> BaseGeometry:
    """Return the area that a vehicle covers, with a margin."""
    rows = track.valid_frames
    length, width = (
        float(np.nanmedian(measured)) if np.isfinite(measured := column[rows]).any() else usual
        for column, usual in zip((track.length, track.width), DEFAULT_SIZE_M[track.category], strict=True)
    )
    size = length + 2 * ASPHALT_MARGIN_M, width + 2 * ASPHALT_MARGIN_M
    poses = np.nan_to_num(np.column_stack((track.x, track.y, track.yaw))[rows[[0, -1]]]).tolist()
    ends = [shapely.Polygon(box_corners(x, y, yaw, *size)) for x, y, yaw in poses]
    path = shapely.LineString(track.xy[rows]) if len(rows) > 1 else shapely.Point(track.xy[rows[0]])
    return shapely.union_all([*ends, path.simplify(TOLERANCE_M).buffer(size[1] / 2)])


def _build_lane_area(lane: MapLane) -> BaseGeometry:
    if min(len(lane.left), len(lane.right)) > 1:
        return shapely.make_valid(shapely.Polygon(np.concatenate((lane.left, lane.right[::-1]))))
    if len(lane.centre) < 2:
        return shapely.Polygon()
    width = lane.width if lane.width > 0 else WIDTH_M.get(lane.kind, LANE_WIDTH_M)
    return shapely.LineString(lane.centre).buffer(width / 2, cap_style="flat")


def _to_polygon(area: MapArea) -> shapely.Polygon:
    return shapely.Polygon(area.outline, area.holes)


def collect_drivable_areas(map: HdMap) -> tuple[DrivableArea, ...]:
    """Return the map's areas near its driving lanes and the observed ones, for network.json.

    With them its bicycle, parking and shoulder lanes.
    """
    aside = [_build_lane_area(lane) for lane in map.lanes.values() if lane.kind in WIDTH_M]
    whole = shapely.union_all([*aside, *(_to_polygon(area) for area in map.drivable_areas)])
    lines = [lane.centre for lane in map.lanes.values() if lane.kind is LaneKind.DRIVING and len(lane.centre) > 1]
    near = shapely.buffer(shapely.MultiLineString(lines).simplify(1.0), MAP_AREA_RANGE_M, quad_segs=4)
    observed = [_to_polygon(area) for area in map.observed_areas]
    kept = shapely.union_all([shapely.intersection(whole, near), *observed]).simplify(TOLERANCE_M)
    return tuple(
        DrivableArea(outline=_to_ring(area.outline), holes=tuple(_to_ring(hole) for hole in area.holes))
        for area in split_areas(shapely.set_precision(kept, GRID_M))
    )


def _to_ring(corners: Float) -> tuple[tuple[float, float], ...]:
    return tuple((round(x, 2), round(y, 2)) for x, y in corners.tolist())
