"""Conflicts with logged vehicles: the same answer from the Python text and from the compiled layer."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from testing.twins import compare_twins

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.sumo.conflict import MovingBox, find_conflicts
from mdrive_sumo.sumo.logged_poses import LoggedPoses

PLACE = st.one_of(st.floats(-25.0, 25.0), st.integers(-3, 3).map(float))
MOVERS = st.builds(
    MovingBox, PLACE, PLACE, st.floats(-4, 4), st.floats(-1, 15), st.floats(0, 6), st.floats(0, 3), st.booleans()
)


@st.composite
def logs(draw: st.DrawFn) -> LoggedPoses:
    vehicles, ticks = draw(st.integers(0, 3)), draw(st.integers(1, 80))
    start = draw(arrays(np.float64, (vehicles, 1, 4), elements=PLACE))
    step = draw(arrays(np.float64, (vehicles, 1, 4), elements=st.floats(-0.5, 0.5)))
    present = draw(arrays(np.bool_, (vehicles, ticks), elements=st.booleans(), fill=st.just(True)))
    sizes = draw(arrays(np.float64, (vehicles, 2), elements=st.floats(0.5, 6.0)))
    return LoggedPoses((), start + step * np.arange(ticks)[:, None], present, sizes)


@given(st.data(), logs(), MOVERS)
def test_conflicts(data: st.DataObject, poses: LoggedPoses, mover: MovingBox) -> None:
    tick = data.draw(st.integers(0, poses.present.shape[1] - 1))
    candidates = data.draw(arrays(np.bool_, len(poses.poses), elements=st.booleans(), fill=st.just(True)))
    compare_twins("sumo_conflict_find_conflicts", poses, tick, candidates, mover)


def test_a_direction_that_is_no_number_is_refused() -> None:
    poses = LoggedPoses((), np.zeros((1, 9, 4)), np.ones((1, 9), dtype=np.bool_), np.ones((1, 2)))
    candidates: Bool = np.ones(1, dtype=np.bool_)
    standing = MovingBox(0.0, 0.0, 0.0, 0.0, 2.0, 2.0)
    assert find_conflicts(poses, 0, candidates, standing).tolist() == [True]
    compare_twins("sumo_conflict_find_conflicts", poses, 0, candidates, MovingBox(0, 0, float("nan"), 0, 2, 2))
    poses.poses[0, 3, 2] = np.inf
    compare_twins("sumo_conflict_find_conflicts", poses, 0, candidates, standing)


def test_conflicts_at_the_limits() -> None:
    """Vehicles that drive about as fast as the mover and meet it, or nearly, within the prediction or after it."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        mover = MovingBox(0.0, 0.0, 0.0, rng.uniform(-2.0, 12.0), 4.0, 2.0, bool(rng.integers(2)))
        count, ticks = 30, int(rng.integers(50, 90))
        yaw = rng.choice((0.0, 1.5, 3.0), count) + 0 * np.arange(ticks)[:, None]
        speed = rng.uniform(0.0, 12.0, count) + 0 * yaw
        time = 0.05 * np.arange(ticks)[:, None]
        x = rng.uniform(-30.0, 45.0, count) + speed * time * np.cos(yaw)
        y = rng.choice((0.0, 2.15, -20.0), count) + speed * time * np.sin(yaw)
        poses = LoggedPoses(
            (),
            np.stack((x, y, yaw, speed), axis=-1).swapaxes(0, 1),
            np.ones((count, ticks), dtype=np.bool_),
            np.tile((4.0, 2.0), (count, 1)),
        )
        compare_twins("sumo_conflict_find_conflicts", poses, 0, np.ones(count, dtype=np.bool_), mover)
