"""Compiled metrics have the bits of the Python text."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.scoring.metrics.collisions import find_new_contacts
from mdrive_sumo.scoring.metrics.min_pet import compute_min_pet
from mdrive_sumo.scoring.metrics.min_ttc import compute_min_ttc

Columns = dict[str, Any]
USED = find_new_contacts, compute_min_pet, compute_min_ttc


@st.composite
def build_frames(draw: st.DrawFn) -> Columns:
    """Return road users that drive straight on or turn through a small place, each for some of the time."""
    seed, count, ticks = draw(st.integers(0, 10**6)), draw(st.integers(1, 5)), draw(st.integers(0, 140))
    rng = np.random.default_rng(seed)
    time = np.arange(ticks)[:, None] * 0.1
    yaw = rng.uniform(-3.0, 3.0, count) + time * rng.choice((0.0, 0.0, 0.5), count)
    if draw(st.booleans()):
        yaw = np.round(yaw / (np.pi / 2)) * (np.pi / 2)
    speed = rng.choice((0.0, 1.0, 5.0, 12.0), count) + 0 * time
    x = rng.uniform(-20.0, 20.0, count) + speed * time * np.cos(yaw[:1])
    y = rng.uniform(-20.0, 20.0, count) + speed * time * np.sin(yaw[:1])
    valid = (time >= rng.choice((0.0, 3.0), count)) & (time < rng.choice((5.0, 99.0), count))
    length, width = rng.choice((4.9, 0.5), count), rng.choice((2.0, 0.5), count)
    return {"x": x, "y": y, "yaw": yaw, "speed": speed, "valid": valid, "length": length, "width": width}


@pytest.mark.slow
@given(build_frames())
def test_times_between_road_users(frames: Columns) -> None:
    for column in range(len(frames["length"])):
        compare_twins("scoring_metrics_min_ttc__find_least_time", *frames.values(), column)
        without_speed = [values for name, values in frames.items() if name != "speed"]
        compare_twins("scoring_metrics_min_pet__find_least_lag", *without_speed, column)


def test_frames_that_do_not_fit_are_refused() -> None:
    frames, columns = np.zeros((3, 2)), np.ones(2)
    for name, extra in (("min_ttc__find_least_time", (frames,)), ("min_pet__find_least_lag", ())):
        find = get_compiled(f"scoring_metrics_{name}")
        for x, valid, length, column in (
            (frames[:2], frames > 0, columns, 0),
            (frames, frames[:, :1] > 0, columns, 0),
            (frames, frames > 0, columns[:1], 0),
            (frames, frames > 0, columns, 2),
            (frames, frames > 0, columns, -1),
        ):
            with pytest.raises(ValueError, match="expected the"):
                find(x, frames, frames, *extra, valid, length, columns, column)


STEPS = st.one_of(st.floats(-3.0, 3.0), st.sampled_from((0.0, float("nan"))))


@example([(0.0, 0.0), (float("nan"), 0.0)], [(0, "a"), (1, "b")], 0)
@given(
    st.lists(st.tuples(STEPS, STEPS), max_size=30),
    st.lists(st.tuples(st.integers(0, 30), st.sampled_from(("", "a", "b"))), max_size=30),
    st.sampled_from((0, 95)),
)
def test_new_contacts(steps: list[tuple[float, float]], contacts: list[tuple[int, str]], pause: int) -> None:
    """The CAV stands for `pause` ticks after the tenth: the last actor is forgotten after 100."""
    xy = np.cumsum(np.array(steps).reshape(-1, 2), axis=0)
    xy = np.concatenate((xy[:10], np.repeat(xy[9:10], pause, axis=0), xy[10:]))
    contacts = sorted((tick + (pause if tick > 10 else 0), other) for tick, other in contacts)
    compare_twins(
        "scoring_metrics_collisions_find_new_contacts",
        xy,
        [tick for tick, _ in contacts],
        [name for _, name in contacts],
    )


def test_new_contacts_at_the_limits() -> None:
    """Contacts all the time, with steps after which places and actors are just remembered or just forgotten."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        xy = np.cumsum(rng.choice((0.0, 0.0, 0.25, 0.5, -0.5), (240, 2)), axis=0)
        ticks = np.sort(rng.integers(0, 240, 60)).tolist()
        others = rng.choice(("", "a", "b"), 60).tolist()
        compare_twins("scoring_metrics_collisions_find_new_contacts", xy, ticks, others)
    for pause in range(98, 103):
        compare_twins(
            "scoring_metrics_collisions_find_new_contacts",
            np.arange(240.0).repeat(2).reshape(-1, 2),
            [1, 1 + pause],
            ["a", "a"],
        )


def build_pair(angle: float, speeds: tuple[float, float], begin: float, ticks: int) -> Columns:
    """Return two road users whose paths cross at the origin; the second one starts `begin` [m] before it."""
    yaw, speed, place = np.array((0.0, angle)), np.array(speeds), np.array((-12.0, -begin))
    way = place + speed * 0.1 * np.arange(ticks)[:, None]
    x, y = way * np.cos(yaw), way * np.sin(yaw)
    columns = np.broadcast_to(yaw, x.shape), np.broadcast_to(speed, x.shape), np.ones(x.shape, dtype=np.bool_)
    return dict(
        zip(
            ["x", "y", "yaw", "speed", "valid", "length", "width"],
            (x, y, *columns, np.full(2, 4.9), np.full(2, 2.0)),
            strict=True,
        )
    )


def test_times_at_the_limits() -> None:
    """Paths that cross at about the least angle, gaps about as long as the horizons, pairs that approach slowly."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        frames = build_pair(np.radians(rng.uniform(25.0, 40.0)), (6.0, 6.0), 12.0 + 6.0 * rng.uniform(3.0, 6.5), 110)
        del frames["speed"]
        compare_twins("scoring_metrics_min_pet__find_least_lag", *frames.values(), 0)
    for _ in range(150):
        frames = build_pair(
            rng.choice((0.0, 3.0)), (8.0 + rng.choice((0.9, 1.1, 1.4)), 8.0), -rng.uniform(-5.0, 5.0), 12
        )
        compare_twins("scoring_metrics_min_ttc__find_least_time", *frames.values(), 0)
