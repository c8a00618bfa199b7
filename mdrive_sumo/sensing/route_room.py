"""How much room there is on the road: what a car may drive on to either side of its route."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap

REACH_M = 10.0
"""Room is not looked for further away."""
SEAM_M = 0.1
"""Strips of neighbouring lanes may leave a gap of that width between each other, which is no edge of the road."""


class _Surface(NamedTuple):
    """What cars drive on, in pieces, and a search tree of it."""

    pieces: npt.NDArray[np.object_]
    tree: shapely.STRtree


def compute_route_room(roads: RoadMap, xy: Float, yaw: Float) -> Float:
    """Free width (N, 2) [m] to the left and to the right of route points xy (N, 2) [m] whose lane points to yaw (N,).

    Measured across the lane, up to the edge of all lanes and junctions together, oncoming lanes included; at most
    `REACH_M`.
    """
    surface = _surface(roads)
    near = np.unique(surface.tree.query(shapely.LineString(xy), predicate="dwithin", distance=REACH_M))
    area = shapely.buffer(shapely.union_all(surface.pieces[near]), -SEAM_M)
    shapely.prepare(area)
    left = np.column_stack((-np.sin(yaw), np.cos(yaw))) * REACH_M
    return np.column_stack([_reached(area, xy, side) for side in (left, -left)])


def _reached(area: shapely.Geometry, xy: Float, across: Float) -> Float:
    """(N,) how far [m] one can go from each point in that direction before one leaves the area for the first time."""
    rays = shapely.linestrings(np.stack((xy, xy + across), axis=1))
    gone = np.asarray(shapely.distance(shapely.points(xy), shapely.difference(rays, area)))
    return np.where(np.isnan(gone), REACH_M, gone)


@lru_cache(maxsize=8)
def _surface(roads: RoadMap) -> _Surface:
    """Lanes wider by `SEAM_M` on either side, and junctions without what belongs to pedestrians in them."""
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in roads.driving], dtype=object)
    lanes = shapely.buffer(lines, roads.lane_width / 2 + SEAM_M)
    feet = shapely.STRtree([shapely.make_valid(shapely.Polygon(outline)) for outline in roads.pavements])
    junctions = [_without(shapely.buffer(shapely.Polygon(outline), SEAM_M), feet) for outline in roads.junctions]
    pieces = np.array([*lanes, *junctions], dtype=object)
    return _Surface(pieces, shapely.STRtree(pieces))


def _without(junction: shapely.Geometry, feet: shapely.STRtree) -> shapely.Geometry:
    walked = feet.geometries[feet.query(junction, predicate="intersects")]
    return shapely.difference(junction, shapely.union_all(walked)) if len(walked) else junction
