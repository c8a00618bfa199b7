"""The paths of all moving scripted actors in one array of knots, with linear interpolation in between."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.actors.motion_path import MotionPath
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int

ROW_STRIDE = 1e6
"""Offset between the search keys of successive paths, more than any arc length [m] or time [s]."""

Rows = npt.NDArray[np.void]
"""(K,) of `KNOT`, or (M,) of `movers.MOVER`."""
KNOT = np.dtype(
    [
        ("progress_key", "f8"),  # index of the path * ROW_STRIDE + progress: ascends over all paths
        ("length_key", "f8"),  # index of the path * ROW_STRIDE + s
        ("progress", "f8"),  # arc length [m]; of a replay the time [s]
        ("s", "f8"),  # arc length [m]
        ("x", "f8"),  # [m]
        ("y", "f8"),
        ("yaw", "f8"),  # [rad], unwrapped
    ]
)


class PathPoints(NamedTuple):
    """Points on paths; all arrays have one shape."""

    x: Float
    y: Float
    yaw: Float
    """Direction of motion [rad]."""


def build_knots(paths: Sequence[MotionPath]) -> Rows:
    """Return the knots of paths, one path after another."""
    parts = [np.zeros(0, KNOT)]
    for i, path in enumerate(paths):
        part = np.zeros(len(path.progress), KNOT)
        for name in ("progress", "s", "x", "y", "yaw"):
            part[name] = getattr(path, name)
        part["progress_key"] = i * ROW_STRIDE + path.progress
        part["length_key"] = i * ROW_STRIDE + path.s
        parts.append(part)
    return np.concatenate(parts)


def sample_ahead(movers: Rows, knots: Rows, rows: Int, s: Float) -> PathPoints:
    """Return the (R, S) points of the paths of the movers `rows` (R,) at arc lengths s (R, S)."""
    first, last = movers["first"][rows][:, None], movers["last"][rows][:, None]
    s = np.minimum(s, movers["path_length"][rows][:, None])
    # side="left" finds the first of the equal arc lengths of a replay that stands.
    after = np.searchsorted(knots["length_key"], rows[:, None] * ROW_STRIDE + s, side="left")
    after = np.clip(after, first + 1, last)
    low, high = knots[after - 1], knots[after]
    step = high["s"] - low["s"]
    share = np.where(step > 0.0, (s - low["s"]) / np.where(step > 0.0, step, 1.0), 0.0)
    dx, dy = high["x"] - low["x"], high["y"] - low["y"]
    yaw = np.where(step > 1e-6, portable.atan2(dy, dx), low["yaw"])
    return PathPoints(low["x"] + share * dx, low["y"] + share * dy, yaw)
