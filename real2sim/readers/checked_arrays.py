"""Check arrays and points of untrusted logs."""

from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float


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
    return " ".join(repr(raw)[:60].split())


def parse_all_points(where: str, raw: Any) -> Float:
    """Return the first two columns (N, 2) [m] of a list of points, N >= 1; raise InputError."""
    xy = parse_numbers(where, raw)
    if xy.ndim != 2 or xy.shape[1] < 2 or not len(xy):
        raise InputError(f"{where}: expected points with x and y, found {describe_value(raw)}")
    xy = xy[:, :2]
    finite = np.isfinite(xy).all(1)
    if not finite.all():
        raise InputError(f"{where}: expected finite coordinates, found {xy[~finite][0].tolist()}")
    return xy


def parse_points(where: str, raw: Any) -> Float:
    """Like `parse_all_points`, without consecutive duplicates (closer than 1 mm); raise InputError."""
    xy = parse_all_points(where, raw)
    return xy[np.concatenate(((True,), np.hypot(*np.diff(xy, axis=0).T) > 1e-3))]
