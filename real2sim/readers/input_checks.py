"""Check values of untrusted logs: arrays, points, the number of frames; and packages that single readers need."""

import reprlib
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.installation_command import format_installation
from real2sim.recording import Recording

MAX_FRAMES = 36_000
"""An hour at 10 Hz; the longest recordings of the sources that are read take 20 minutes."""
MAX_ROWS = 20_000_000
"""Frames times tracks: 1.1 GB of poses and sizes."""
MAX_COORDINATE_M = 1e8
"""[m] Any projection of the earth has smaller ones."""
MAX_SIZE_M = 200.0
"""[m] Longer than any road vehicle or barrier."""
MAX_LINE_M = 1e5
"""[m] Of one line of a map. Later steps make a point for every metre or two."""


def check_frame_count(where: str, count: float, tracks: int = 1) -> int:
    """Return the number of frames; raise InputError before arrays are made for it that no memory holds."""
    if not count <= MAX_FRAMES:
        raise InputError(
            f"{where}: expected times within {MAX_FRAMES} frames, found {min(count, 1e300):g} from first to last"
        )
    if count * tracks > MAX_ROWS:
        raise InputError(
            f"{where}: expected at most {MAX_ROWS} rows of frames and tracks, found {count:g} frames of {tracks} tracks"
        )
    return int(count)


def check_extent(path: Path, recording: Recording) -> None:
    """Raise InputError for positions and sizes that are finite but of no place on earth: sums of them are infinite."""
    for track in (track for view in recording.views for track in view.tracks):
        for name, limit in (
            ("x", MAX_COORDINATE_M),
            ("y", MAX_COORDINATE_M),
            ("length", MAX_SIZE_M),
            ("width", MAX_SIZE_M),
        ):
            column = getattr(track, name)
            if (np.abs(column[np.isfinite(column)]) > limit).any():
                raise InputError(f"{path}: track {track.id}: {name}: expected at most {limit:g} m, found more")


def find_gap(numbers: Iterable[int]) -> int | None:
    """Return the first whole number that is missing between the least and the largest; None without a gap."""
    ordered = sorted(numbers)
    return next((before + 1 for before, after in pairwise(ordered) if after > before + 1), None)


def parse_numbers(where: str, raw: Any) -> Float:
    """Return an array of any shape; raise InputError if it does not consist of numbers."""
    try:
        return np.asarray(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: expected numbers, found {describe_value(raw)}") from None


def describe_value(raw: Any) -> str:
    """Describe any value for an error message."""
    if isinstance(raw, np.ndarray):
        return f"an array of {raw.dtype.name} of shape {raw.shape}"
    return " ".join(_SHORT.repr(raw)[:60].split())


_SHORT = reprlib.Repr()
"""A whole `repr` of nested lists that share their parts takes more time than there is."""
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxtuple, _SHORT.maxdict, _SHORT.maxstring, _SHORT.maxother = 3, 6, 6, 4, 60, 60


def parse_all_points(where: str, raw: Any) -> Float:
    """Return the first two columns (N, 2) [m] of a list of points, N >= 1; raise InputError."""
    xy = parse_numbers(where, raw)
    if xy.ndim != 2 or xy.shape[1] < 2 or not len(xy):
        raise InputError(f"{where}: expected points with x and y, found {describe_value(raw)}")
    xy = xy[:, :2]
    finite = np.isfinite(xy).all(1)
    if not finite.all():
        raise InputError(f"{where}: expected finite coordinates, found {xy[~finite][0].tolist()}")
    far = (np.abs(xy) > MAX_COORDINATE_M).any(1)
    if far.any():
        raise InputError(f"{where}: expected coordinates within {MAX_COORDINATE_M:g} m, found {xy[far][0].tolist()}")
    return xy


def is_empty(raw: Any) -> bool:
    """Return whether a value of a log holds nothing: None, or a list or array without any element."""
    if isinstance(raw, np.ndarray):
        return raw.size == 0
    return raw is None or (isinstance(raw, list | tuple) and not raw)


def parse_points(where: str, raw: Any) -> Float:
    """Like `parse_all_points`, without consecutive duplicates (closer than 1 mm); raise InputError."""
    xy = parse_all_points(where, raw)
    steps = np.hypot(*np.diff(xy, axis=0).T)
    if (length := float(steps.sum())) > MAX_LINE_M:
        raise InputError(f"{where}: expected a line of at most {MAX_LINE_M:g} m, found {length:g} m")
    return xy[np.concatenate(((True,), steps > 1e-3))]


def build_missing_error(path: Path, package: str) -> InputError:
    """Return the error for a file that needs a package that is not installed."""
    return InputError(f"{path}: expected {package} to be installed, found none: {format_installation('convert')}")
