"""Position of trajectories relative to the lanes of a map: lateral offset, off-route and wrong-way frames."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles

SAME_LANE_M = 3.0
"""[m] Lanes this near are treated like the nearest one (further is off the route): in a junction all directions
overlap."""
ALMOST_M = 0.25
"""[m] A lane this much further away than the nearest one counts as near too."""
USUAL_WIDTH_M = 3.5
"""[m] Lane width that the distances of MDrive's checks assume; in a wider lane they count from further out."""
OUTSIDE_M = 10.0
"""[m] Further from all lanes there is no map: parking lots, streets that the source leaves out."""


@dataclass(frozen=True)
class LaneSegmentIndex:
    """Spatial index of the segments of all lanes. `lane` is the index of the centre line."""

    starts: Float
    """First points (S, 2) [m] of the segments."""
    vectors: Float
    """Vectors (S, 2) [m] from the first to the last points."""
    lane: Int
    directed: Bool
    wider: Float
    """(S,) [m] by how much half the lane is wider than half a usual one."""
    tree: shapely.STRtree

    @classmethod
    def from_centre_lines(
        cls, lines: Iterable[Float], directed: Iterable[bool], widths: Iterable[float] | None = None
    ) -> "LaneSegmentIndex":
        """Return the index of centre lines (N, 2) [m] with lane widths [m]; a `directed` line runs in the direction of
        travel."""
        lines, flags = [np.asarray(line, dtype=np.float64)[:, :2] for line in lines], list(directed)
        starts = np.concatenate([line[:-1] for line in lines] or [np.zeros((0, 2))])
        ends = np.concatenate([line[1:] for line in lines] or [np.zeros((0, 2))])
        counts = [len(line) - 1 for line in lines]
        tree = shapely.STRtree([shapely.LineString(ends_of) for ends_of in np.stack((starts, ends), axis=1)])
        lane = np.repeat(np.arange(len(lines)), counts)
        width = np.full(len(lines), USUAL_WIDTH_M) if widths is None else np.array(list(widths), dtype=np.float64)
        wider = np.repeat(np.maximum(np.nan_to_num(width, nan=USUAL_WIDTH_M) - USUAL_WIDTH_M, 0.0) / 2, counts)
        return cls(starts, ends - starts, lane, np.repeat(np.array(flags, dtype=np.bool_), counts), wider, tree)

    def is_outside(self, xy: Float) -> Bool:
        """Return a mask (N,): points (N, 2) that the map does not cover, far from all lanes or beyond the open end of
        the nearest one."""
        if not len(self.starts) or not len(xy):
            return np.ones(len(xy), dtype=np.bool_)
        point, segment = self.tree.query_nearest(shapely.points(xy), all_matches=False)
        relative = xy[point] - self.starts[segment]
        length = np.maximum(np.hypot(*self.vectors[segment].T), 1e-9)
        along = (relative * self.vectors[segment]).sum(1) / length
        beyond = np.maximum(along - length, -along)
        result = np.ones(len(xy), dtype=np.bool_)
        result[point] = beyond > 0.1
        return result & (self.offsets(xy) > USUAL_WIDTH_M / 2) | (self.offsets(xy) > OUTSIDE_M)

    def offsets(self, xy: Float) -> Float:
        """Return distances (N,) [m] of points (N, 2) from the nearest centre line; infinite without any lane.

        In a lane wider than usual the distance counts from further out, so that the edge of every lane is equally far
        away.
        """
        distance = np.full(len(xy), np.inf)
        if len(self.starts) and len(xy):
            nearest, reach = self.tree.query_nearest(shapely.points(xy), all_matches=False, return_distance=True)
            distance[nearest[0]] = np.maximum(reach - self.wider[nearest[1]], 0.0)
        return distance

    def heading_deviations(self, xy: Float, yaw: Float, offsets: Float | None = None) -> Float:
        """Return angles (N,) [rad] between a heading and the best aligned directed lane near each point; 0 without one.

        Near are all lanes within `SAME_LANE_M`, and those at most `ALMOST_M` further away than the nearest one; in a
        lane wider than usual the distance counts from further out, as in `offsets`.
        """
        nearest = self.offsets(xy) if offsets is None else offsets
        reach = np.where(np.isfinite(nearest), np.maximum(nearest + ALMOST_M, SAME_LANE_M), 0.0)
        points: Any = shapely.points(xy)
        widest = float(self.wider.max(initial=0.0))
        point, segment = self.tree.query(points, predicate="dwithin", distance=reach + widest)
        gap = shapely.distance(points[point], self.tree.geometries[segment]) - self.wider[segment]
        near = self.directed[segment] & (gap <= reach[point])
        point, segment = point[near], segment[near]
        direction = np.arctan2(self.vectors[segment, 1], self.vectors[segment, 0])
        away = np.full(len(xy), np.inf)
        np.minimum.at(away, point, np.abs(wrap_angles(direction - yaw[point])))
        return np.where(np.isfinite(away), away, 0.0)
