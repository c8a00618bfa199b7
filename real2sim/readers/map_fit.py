"""Whether a map shows the place of a log."""

from collections.abc import Sequence

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap
from real2sim.recording import ObserverView

OFF_MAP_M = 30.0
"""[m] A point further from any lane is off the map."""
MAX_OFF_MAP_SHARE = 0.5
"""A larger share of points off the map means that the map shows another place."""
MAX_PROBES = 3000
"""Number of track points that suffices to tell whether a map fits."""


def measure_lane_gaps(views: Sequence[ObserverView], hd_map: HdMap) -> Float:
    """Return the distances (N,) [m] of track points and poses, evenly thinned, to the nearest centre line."""
    points = np.concatenate(
        [view.pose[np.isfinite(view.pose[:, 0]), :2] for view in views]
        + [track.xy[track.valid] for view in views for track in view.tracks]
    )
    points = points[:: -(-len(points) // MAX_PROBES)]
    tree = shapely.STRtree([shapely.LineString(lane.centre) for lane in hd_map.lanes.values()])
    _, gaps = tree.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    return gaps


def check_place(where: str, gaps: Float) -> None:
    """Raise InputError for tracks beside the lanes of the map, see `measure_lane_gaps`."""
    share = float((gaps > OFF_MAP_M).mean())
    if share > MAX_OFF_MAP_SHARE:
        raise InputError(
            f"{where}: expected tracks on the lanes of the map, found {share:.0%} of their points more than "
            f"{OFF_MAP_M:g} m off: it is the map of another place, or of another frame"
        )
