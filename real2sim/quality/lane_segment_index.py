"""Position of trajectories relative to the lanes of a map: lateral offset, off-route and wrong-way frames."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from real2sim.segment_tree import SegmentTree

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
    """Spatial index of the segments of all lanes."""

    segments: SegmentTree
    directed: Bool
    """Whether the segments (S,) run in the direction of travel."""
    wider: Float
    """(S,) [m] by how much half the lane is wider than half a usual one."""

    @classmethod
    def from_centre_lines(
        cls, lines: Iterable[Float], directed: Iterable[bool], widths: Iterable[float] | None = None
    ) -> "LaneSegmentIndex":
        """Return the index of centre lines (N, 2) [m] with lane widths [m]; a `directed` line runs in the direction of
        travel."""
        segments = SegmentTree.from_lines([np.asarray(line, dtype=np.float64)[:, :2] for line in lines])
        flags = np.array(list(directed), dtype=np.bool_)
        width = np.full(len(flags), USUAL_WIDTH_M) if widths is None else np.array(list(widths), dtype=np.float64)
        wider = np.maximum(np.nan_to_num(width, nan=USUAL_WIDTH_M) - USUAL_WIDTH_M, 0.0) / 2
        return cls(segments, flags[segments.line], wider[segments.line])

    def locate(self, xy: Float) -> tuple[Float, Bool]:
        """Return the `offsets` (N,) of points (N, 2), and a mask (N,): those that the map does not cover, far from all
        lanes or beyond the open end of the nearest one."""
        offset, is_beyond = np.full(len(xy), np.inf), np.ones(len(xy), dtype=np.bool_)
        if len(self.directed) and len(xy):
            point, segment, distance = self.segments.find_nearest(xy)
            offset[point] = np.maximum(distance - self.wider[segment], 0.0)
            relative, vector = xy[point] - self.segments.begin[segment], self.segments.vector[segment]
            length = np.maximum(np.hypot(*vector.T), 1e-9)
            along = (relative * vector).sum(1) / length
            is_beyond[point] = np.maximum(along - length, -along) > 0.1
        return offset, is_beyond & (offset > USUAL_WIDTH_M / 2) | (offset > OUTSIDE_M)

    def offsets(self, xy: Float) -> Float:
        """Return distances (N,) [m] of points (N, 2) from the nearest centre line; infinite without any lane.

        In a lane wider than usual the distance counts from further out, so that the edge of every lane is equally far
        away.
        """
        return self.locate(xy)[0]

    def heading_deviations(self, xy: Float, yaw: Float, offsets: Float | None = None) -> Float:
        """Return angles (N,) [rad] between a heading and the best aligned directed lane near each point; 0 without one.

        Near are all lanes within `SAME_LANE_M`, and those at most `ALMOST_M` further away than the nearest one; in a
        lane wider than usual the distance counts from further out, as in `offsets`.
        """
        nearest = self.offsets(xy) if offsets is None else offsets
        reach = np.where(np.isfinite(nearest), np.maximum(nearest + ALMOST_M, SAME_LANE_M), 0.0)
        point, segment, distance, _ = self.segments.find_near(xy, reach + float(self.wider.max(initial=0.0)))
        near = self.directed[segment] & (distance - self.wider[segment] <= reach[point])
        point, vector = point[near], self.segments.vector[segment[near]]
        direction = np.arctan2(vector[:, 1], vector[:, 0])
        away = np.full(len(xy), np.inf)
        np.minimum.at(away, point, np.abs(wrap_angles(direction - yaw[point])))
        return np.where(np.isfinite(away), away, 0.0)
