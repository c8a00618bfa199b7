"""Whether a map shows the place of a log."""

from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.recording import ObserverView, Recording

OFF_MAP_M = 30.0
"""[m] A point further than this from every lane is off the map: wider than any car park beside a road."""
MAX_OFF_MAP_SHARE = 0.5
"""A larger share of points off the map means that the map shows another place."""
MAX_PROBES = 3000
"""Number of track points that suffices to tell whether a map fits."""
PROBES_PER_VEHICLE = 10
"""At most so many points of every vehicle are looked at: a parked car counts as much as one that passes."""


def measure_lane_gaps(views: Sequence[ObserverView], hd_map: HdMap) -> Float:
    """Return the distances (N,) [m] of track points and poses, evenly thinned, to the nearest centre line."""
    points = np.concatenate(
        [view.pose[np.isfinite(view.pose[:, 0]), :2] for view in views]
        + [track.xy[track.valid] for view in views for track in view.tracks]
    )
    return _measure_distances(points[:: -(-len(points) // MAX_PROBES)], hd_map.lanes.values())


def check_place(where: str, gaps: Float) -> None:
    """Raise InputError for tracks beside the lanes of the map, see `measure_lane_gaps`."""
    share = float((gaps > OFF_MAP_M).mean())
    if share > MAX_OFF_MAP_SHARE:
        raise InputError(
            f"{where}: expected tracks on the lanes of the map, found {share:.0%} of their points more than "
            f"{OFF_MAP_M:g} m off: it is the map of another place, or of another frame"
        )


def check_on_map(recording: Recording) -> None:
    """Raise InputError if most of the vehicles' points lie off the driving lanes of the map."""
    tracks = [track for view in recording.views for track in view.tracks if track.category.kind is Kind.VEHICLE]
    points = [
        track.xy[track.valid_frames[:: max(len(track.valid_frames) // PROBES_PER_VEHICLE, 1)]] for track in tracks
    ]
    lanes = [lane for lane in recording.map.lanes.values() if lane.kind is LaneKind.DRIVING and len(lane.centre) > 1]
    if not lanes or not sum(map(len, points)):  # `build_network` refuses a map without a lane
        return
    gaps = _measure_distances(np.concatenate(points), lanes)
    share = float((gaps > OFF_MAP_M).mean())
    if share > MAX_OFF_MAP_SHARE:
        raise InputError(
            f"expected tracks on the lanes of the map, found {share:.0%} of the vehicles' points more than"
            f" {OFF_MAP_M:g} m off (median {np.median(gaps):.0f} m): it is the map of another place"
        )


def _measure_distances(points: Float, lanes: Iterable[MapLane]) -> Float:
    """Return the distances (N,) [m] of points (N, 2) to the nearest centre line."""
    tree = shapely.STRtree([shapely.LineString(lane.centre) for lane in lanes])
    _, gaps = tree.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    return gaps
