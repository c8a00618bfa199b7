"""Converts one log of any source into the draft of a suite, or splits it into windows.

A log goes one way: here it is read, cut and moved to its origin; `build_scenario` cleans it, builds its network, fits
its traffic and measures the result; then its files are written. `batch` draws the pages at the end, from the findings.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import save_episode
from mdrive_sumo.scenario.scenario import save_scenario
from mdrive_sumo.scenario.suite import LOG_FILE
from real2sim.clean import MIN_FRAMES
from real2sim.hd_map import HdMap, MapArea
from real2sim.pipeline.conversion_options import ConversionOptions
from real2sim.pipeline.limited_reader import read_log_limited
from real2sim.pipeline.log_source import LogSource, prefix_with_log
from real2sim.pipeline.quality_file import build_quality_file, save_quality
from real2sim.pipeline.scenario_builder import BuiltScenario, build_scenario
from real2sim.readers.time_grid import TimeWindow, crop_recording
from real2sim.recording import ObserverView, Recording
from real2sim.source_scene import SourceScene

BUCKETS = {"v2xpnp": "V2XPnP"}
CATEGORY = "real2sim"
MAX_LOG_S = 60.0
"""[s] Longer logs need a window: an episode lasts seconds."""
MIN_LOG_S = 2.0
"""[s] Shorter logs would pass almost unchecked: turns are measured within one second, traffic against the log after one
and two seconds."""
PROPOSED_WINDOW_S = 20.0
"""[s] Length that the error for a long log proposes: about that of a nuScenes scene."""
LARGEST_M = 900_000.0
"""[m] Scenarios hold up to 1 000 000 m; routes go on beyond the log, and the margin is for them."""
ROUNDED_M = 1000.0
"""[m] The origin is a multiple of this, so that people can add it in their heads."""


def convert_log(log: LogSource, draft: Path, wish: ConversionOptions) -> BuiltScenario:
    """Write DRAFT/<id>/ and DRAFT/networks/<id>/; raises InputError with one sentence that names the log."""
    try:
        recording = move_to_origin(crop_recording(str(log.path), read_log_limited(log), log.window))
        _check_length(recording)
        built = build_scenario(_build_scene(recording, log.window), draft, replace(wish, window_s=log.window))
    except InputError as error:
        raise InputError(prefix_with_log(log, str(error))) from None
    folder = draft / built.scenario.id
    save_scenario(built.scenario, folder / "scenario.json")
    save_quality(build_quality_file(built.findings), folder)
    save_episode(built.log, folder / LOG_FILE)
    return built


def split_into_windows(log: LogSource, every_s: float) -> tuple[TimeWindow, ...]:
    """Return consecutive windows of that length [s]; a remainder shorter than half of it or `MIN_LOG_S` is dropped."""
    try:
        recording = crop_recording(str(log.path), read_log_limited(log), log.window)
    except InputError as error:
        raise InputError(prefix_with_log(log, str(error))) from None
    first = log.window[0] if log.window else 0.0
    end = first + (recording.frame_count - 1) * recording.dt_s
    starts = [first + k * every_s for k in range(math.ceil((end - first) / every_s - 1e-6))]
    if len(starts) > 1 and end - starts[-1] < max(every_s / 2, MIN_LOG_S) - recording.dt_s / 2:
        starts.pop()
    return tuple((round(start, 3), round(min(start + every_s, end), 3)) for start in starts)


def _check_length(recording: Recording) -> None:
    length_s = (recording.frame_count - 1) * recording.dt_s
    least_s = max(MIN_LOG_S, (MIN_FRAMES - 1) * recording.dt_s)
    if length_s < least_s - recording.dt_s / 2:
        raise InputError(f"expected at least {least_s:g} s, found {length_s:g} s: too short for the checks to say much")
    if length_s > MAX_LOG_S:
        raise InputError(
            f"expected at most {MAX_LOG_S:g} s, found a log of {length_s:g} s: choose a part with"
            f" --window 0,{PROPOSED_WINDOW_S:g}, or cut it into scenarios with --every {PROPOSED_WINDOW_S:g}"
        )


def _build_scene(recording: Recording, window: TimeWindow | None) -> SourceScene:
    part = f", {window[0]:g} s to {window[1]:g} s" if window else ""
    return SourceScene(
        id=make_scenario_id(recording.id, window),
        source=recording.source,
        bucket=BUCKETS.get(recording.source, "Real2Sim"),
        category=CATEGORY,
        map=recording.map,
        recording=recording,
        description=f"{recording.source} log {recording.id}{part}",
        notes=recording.notes,
    )


def make_scenario_id(log: str, window: TimeWindow | None) -> str:
    """Return the id of the log in the characters of an identifier, with its window."""
    part = f"_{window[0]:g}-{window[1]:g}s" if window else ""
    plain = re.sub(r"[^A-Za-z0-9_.+-]", "_", log).lstrip("_.+-") or "log"
    return plain[: 80 - len(part)] + part


def move_to_origin(recording: Recording) -> Recording:
    """Return the recording, shifted if it has coordinates beyond `LARGEST_M`, with its origin and a note.

    Scenarios hold coordinates up to 1000 km, because positions are stored to the millimetre; those of UTM and national
    grids are larger. Exports of episodes add the origin again (`mdrive_sumo.export.log_frame`).
    """
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
        buildings=tuple(_shift_area(area, shift) for area in hd_map.buildings),
        observed_areas=tuple(_shift_area(area, shift) for area in hd_map.observed_areas),
    )


def _shift_area(area: MapArea, shift: Float) -> MapArea:
    return MapArea(area.outline + shift, tuple(hole + shift for hole in area.holes))
