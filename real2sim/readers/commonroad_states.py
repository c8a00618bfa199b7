"""States of CommonRoad obstacles whose position is an area or whose orientation is an interval."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

MAX_HEADING_SPREAD = math.pi / 2
"""[rad] The middle of a wider interval of orientations does not tell which way an obstacle faces."""


def read_pose(state: Any) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [rad] of a state: the centre of an area, the middle of a narrow interval, else NaN."""
    return *_find_position(state), _read_angle(state.orientation)


def note_vague_states(obstacles: Sequence[Sequence[Any]]) -> Iterator[str]:
    """Yield notes on states that are sets; `obstacles` are the states of each."""
    shapes = sum(any(not isinstance(one.position, np.ndarray) for one in states) for states in obstacles)
    intervals = sum(any(not isinstance(one.orientation, int | float) for one in states) for states in obstacles)
    if shapes:
        yield f"{shapes} obstacles whose positions are areas: their centres taken"
    if intervals:
        yield (
            f"{intervals} obstacles whose orientations are intervals: their middles taken,"
            f" none of intervals over {math.degrees(MAX_HEADING_SPREAD):g} degrees"
        )


def _find_position(state: Any) -> tuple[float, float]:
    """Return the position of a state, the centre if it is an area."""
    if isinstance(state.position, np.ndarray):
        return float(state.position[0]), float(state.position[1])
    return float(state.position.center.x), float(state.position.center.y)


def _read_angle(orientation: Any) -> float:
    """Return the angle [rad], the middle of a narrow interval, NaN for a wide one."""
    if isinstance(orientation, int | float):
        return float(orientation)
    spread = float(orientation.end - orientation.start)
    return float(orientation.start) + spread / 2 if spread <= MAX_HEADING_SPREAD else math.nan
