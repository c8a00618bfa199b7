"""Whether a map shows the place of a log."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.recording import ObserverView, Recording
from real2sim.segment_tree import SegmentTree

OFF_MAP_M = 30.0
"""[m] A point further than this from every lane is off the map: wider than any car park beside a road."""
MAX_OFF_MAP_SHARE = 0.5
"""A larger share of points off the map means that the map shows another place."""
MAX_PROBES = 3000
"""Number of track points that suffices to tell whether a map fits."""
PROBES_PER_VEHICLE = 10
"""About so many points of every vehicle are looked at: a parked car counts as much as one that passes."""


class MapFit(NamedTuple):
    """How far the points of a log lie from the lanes of a map; the best of several maps is the least one."""

    off_share: float
    """Share of the points that are more than `OFF_MAP_M` off."""
    median_m: float
    """Median distance [m] to the nearest lane."""

    @property
    def is_same_place(self) -> bool:
        """Whether the map shows the place of the log."""
        return self.off_share <= MAX_OFF_MAP_SHARE


def measure_map_fit(points: Float, lanes: Iterable[MapLane]) -> MapFit:
    """Measure how far points (N, 2) [m] lie from the nearest of the centre lines."""
    _, _, gaps = SegmentTree.from_lines([lane.centre for lane in lanes]).find_nearest(points)
    return MapFit(float((gaps > OFF_MAP_M).mean()), float(np.median(gaps)))


def measure_view_fit(views: Sequence[ObserverView], hd_map: HdMap) -> MapFit:
    """Measure how far all track points and poses of the observers lie from the lanes of a map."""
    poses = [view.pose[np.isfinite(view.pose[:, 0]), :2] for view in views]
    tracks = [track.xy[track.valid] for view in views for track in view.tracks]
    return measure_map_fit(thin_points(np.concatenate(poses + tracks)), hd_map.lanes.values())


def thin_points(points: Float) -> Float:
    """Return at most `MAX_PROBES` of the points (N, 2), evenly chosen."""
    return points[:: -(-len(points) // MAX_PROBES)]


def check_place(where: str, fit: MapFit) -> None:
    """Raise InputError for tracks beside the lanes of the map, see `measure_view_fit`."""
    if not fit.is_same_place:
        raise InputError(
            f"{where}: expected tracks on the lanes of the map, found {fit.off_share:.0%} of their points more than "
            f"{OFF_MAP_M:g} m off: it is the map of another place, or of another frame"
        )


def check_on_map(recording: Recording) -> None:
    """Raise InputError if most of the vehicles' points lie off the driving lanes of the map."""
    tracks = [track for view in recording.views for track in view.tracks if track.category.kind is Kind.VEHICLE]
    strides = [max(len(track.valid_frames) // PROBES_PER_VEHICLE, 1) for track in tracks]
    points = [track.xy[track.valid_frames[::stride]] for track, stride in zip(tracks, strides, strict=True)]
    lanes = [lane for lane in recording.map.lanes.values() if lane.kind is LaneKind.DRIVING and len(lane.centre) > 1]
    if not lanes or not sum(map(len, points)):  # `build_network` refuses a map without a lane
        return
    fit = measure_map_fit(np.concatenate(points), lanes)
    if not fit.is_same_place:
        raise InputError(
            f"expected tracks on the lanes of the map, found {fit.off_share:.0%} of the vehicles' points more than"
            f" {OFF_MAP_M:g} m off (median {fit.median_m:.0f} m): it is the map of another place"
        )
