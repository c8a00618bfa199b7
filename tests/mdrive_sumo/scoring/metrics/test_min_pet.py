"""Minimum post-encroachment time of boxes of 4.9 x 2.0 m, against hand values and all pairs of frames with shapely."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely import Polygon, box
from shapely.affinity import rotate, translate
from testing.sampling import examples
from testing.score_golden import BOX, Row, actor, ego, episode, scenario, straight

from mdrive_sumo.core.state import End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics.min_pet import HORIZON_S, MIN_TURN, compute_min_pet


def two(first: list[Row], second: list[Row]) -> EpisodeRecord:
    about = scenario(ego("0"), ego("1"))
    return episode(about, {"0": first, "1": second}, {"0": End.TIMED_OUT, "1": End.TIMED_OUT})


def northward(ticks: int, x: float, begin: float, speed: float = 10.0) -> list[Row]:
    return [(x, begin + speed * tick / 20, math.pi / 2, speed) for tick in range(ticks)]


@pytest.mark.parametrize(("begin", "expected"), [(-30.0, 2.4), (-20.0, 1.4), (20.0, None), (0.0, 0.0)])
def test_two_cross_at_ten_metres_a_second(begin: float, expected: float | None) -> None:
    """The rear of the first leaves x = 21 (side of the other) at (21 + 2.45 - 20) / 10 s after its centre is there.

    The other's front enters y = -1 at (-1 - 2.45 - begin) / 10 s. With begin = -30 that is 2.655 s; the first has left
    at 0.345 s (it starts in x = 20): 2.31 s, on frames of 0.1 s 2.4.
    """
    first = straight(100, begin=20.0)
    assert compute_min_pet(two(first, northward(100, 20.0, begin))) == expected


def test_one_behind_the_other_has_no_conflict() -> None:
    assert compute_min_pet(two(straight(100), straight(100, begin=-10.0))) is None


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("turn_deg", "is_conflict"), [(0, False), (29, False), (31, True), (90, True), (180, True)])
def test_paths_conflict_where_they_cross_at_thirty_degrees_or_more(turn_deg: int, is_conflict: bool, side: int) -> None:
    """Below that one follows or merges behind the other: docs/scoring.md. The second comes 2 s after the first."""
    yaw = side * math.radians(turn_deg)
    ahead = (np.arange(200) / 20 - 4.5) * 10.0
    second = [(20.0 + s * math.cos(yaw), s * math.sin(yaw), yaw, 10.0) for s in ahead.tolist()]
    found = compute_min_pet(two(straight(200, begin=-5.0), second))
    assert (found is not None) is is_conflict
    assert found is None or found <= 2.0


def test_what_never_moves_is_left_out() -> None:
    """A parked car is driven through: a collision, but no place was left and taken."""
    parked = actor(20.0, 0.0, math.pi / 2)
    assert compute_min_pet(episode(scenario(), {"0": straight(100)}, {"0": End.TIMED_OUT}, actors=parked)) is None


def outline(row: Row, margin: float) -> Polygon:
    x, y, yaw, _ = row
    length, width = (size + 2 * margin for size in BOX)
    return translate(rotate(box(-length / 2, -width / 2, length / 2, width / 2), yaw, use_radians=True), x, y)


def expected_pet(first: list[Row], second: list[Row], margin: float) -> float:
    """The least time between any two frames 0.1 s apart in which outlines overlap across; margin: added around each."""
    least = math.inf
    outlines = {
        (which, tick): outline(row, margin)
        for which, rows in enumerate((first, second))
        for tick, row in enumerate(rows)
    }
    for a, own in list(enumerate(first))[::2]:
        for b, other in list(enumerate(second))[::2]:
            apart = abs(a - b) / 20
            turn = abs(math.remainder(other[2] - own[2], math.tau))
            near = math.hypot(other[0] - own[0], other[1] - own[1]) < math.hypot(*BOX) + 2 * margin
            is_less = apart < least and apart <= HORIZON_S
            if is_less and near and turn >= MIN_TURN and outlines[0, a].overlaps(outlines[1, b]):
                least = apart
    return least


@settings(max_examples=examples(20, 200))
@given(st.floats(-3.0, 3.0), st.floats(2.0, 12.0), st.floats(-25.0, 25.0))
@example(0.9735335844768671, 6.254280118629547, -1.4360082061095802)  # an overlap of 4e-8 square metres
def test_equals_the_least_over_all_pairs_of_frames(yaw: float, speed: float, offset: float) -> None:
    first = straight(60, begin=-10.0)
    steps = (offset + speed * np.arange(60) / 20).tolist()
    second = [(5.0 + s * math.cos(yaw), s * math.sin(yaw), yaw, speed) for s in steps]
    found = compute_min_pet(two(first, second))
    least, most = (expected_pet(first, second, margin) for margin in (0.001, -0.001))
    assert least - 1e-6 <= (math.inf if found is None else found) <= most + 1e-6, "corners that touch count or not"
