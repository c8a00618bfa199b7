"""Move a log whose coordinates are those of a map projection to an origin beside it.

Scenarios hold coordinates up to 1000 km, because positions are stored to the millimetre; those of UTM and national
grids are larger. Exports of episodes add the origin again (`mdrive_sumo.export.log_frame`).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap, MapArea
from real2sim.recording import ObserverView, Recording

LARGEST_M = 900_000.0
"""[m] Scenarios hold up to 1 000 000 m; routes go on beyond the log, and the margin is for them."""
ROUNDED_M = 1000.0
"""[m] The origin is a multiple of this, so that people can add it in their heads."""


def move_to_origin(recording: Recording) -> Recording:
    """Return the recording, shifted if it has coordinates beyond `LARGEST_M`, with its origin and a note."""
    points = np.concatenate([*_list_points(recording), np.zeros((0, 2))])
    points = points[np.isfinite(points).all(1)]
    if not len(points) or np.abs(points).max() <= LARGEST_M:
        return recording
    x, y = (np.round(np.median(points, axis=0) / ROUNDED_M) * ROUNDED_M).tolist()
    shift = -np.array((x, y))
    note = f"coordinates shifted: the origin of the scenario is at ({x:.0f}, {y:.0f}) m of the log"
    return replace(
        recording,
        views=tuple(_shift_view(view, shift) for view in recording.views),
        map=_shift_map(recording.map, shift),
        origin=(x, y),
        notes=(*recording.notes, note),
    )


def _list_points(recording: Recording) -> Iterator[Float]:
    for view in recording.views:
        yield from (track.xy for track in view.tracks)
        yield view.pose[:, :2]
    yield from (lane.centre for lane in recording.map.lanes.values())


def _shift_view(view: ObserverView, shift: Float) -> ObserverView:
    tracks = tuple(track.replace_columns(x=track.x + shift[0], y=track.y + shift[1]) for track in view.tracks)
    return replace(view, tracks=tracks, pose=view.pose + np.array((*shift, 0.0)) if len(view.pose) else view.pose)


def _shift_map(hd_map: HdMap, shift: Float) -> HdMap:
    return replace(
        hd_map,
        lanes={
            id_: replace(lane, centre=lane.centre + shift, left=lane.left + shift, right=lane.right + shift)
            for id_, lane in hd_map.lanes.items()
        },
        crosswalks=tuple(outline + shift for outline in hd_map.crosswalks),
        stop_lines=tuple(replace(line, line=line.line + shift) for line in hd_map.stop_lines),
        drivable_areas=tuple(_shift_area(area, shift) for area in hd_map.drivable_areas),
        observed_areas=tuple(_shift_area(area, shift) for area in hd_map.observed_areas),
    )


def _shift_area(area: MapArea, shift: Float) -> MapArea:
    return MapArea(area.outline + shift, tuple(hole + shift for hole in area.holes))
