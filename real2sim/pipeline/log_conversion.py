"""Converts one log of any source into the draft of a suite, or splits it into windows.

A log goes one way: here it is read, cut and moved to its origin; `build_scenario` cleans it, builds its network, fits
its traffic and measures the result; then its files are written. `batch` draws the pages at the end, from the findings.
"""

import math
import re
from dataclasses import replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import save_episode
from mdrive_sumo.scenario.scenario import save_scenario
from mdrive_sumo.scenario.suite import LOG_FILE
from real2sim.clean import MIN_FRAMES
from real2sim.pipeline.limited_reader import read_log_limited
from real2sim.pipeline.local_origin import move_to_origin
from real2sim.pipeline.log_source import LogSource, prefix_with_log
from real2sim.pipeline.quality_file import build_quality_file, save_quality
from real2sim.pipeline.scenario_builder import BuiltScenario, ConversionOptions, build_scenario
from real2sim.readers.time_grid import TimeWindow, crop_recording
from real2sim.recording import Recording
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
