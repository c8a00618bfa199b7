"""The compiled functions of scripted actors give the bits of the Python text."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.actors.actor_surroundings import STATIC
from mdrive_sumo.actors.kinematic_limits import LIMITS_BY_KIND
from mdrive_sumo.actors.motion_path import MotionPath
from mdrive_sumo.actors.movers import MOVER, set_paths
from mdrive_sumo.actors.path_tables import KNOT, Rows
from mdrive_sumo.core import compiled
from mdrive_sumo.core.state import DT, Actors, EgoState, Kind

NAN, INF = math.nan, math.inf
TICK = 40
SEEDS = st.integers(0, 2**32 - 1)
BAD = st.sampled_from((None, None, None, NAN, INF, -INF, 0.0, -0.0))
FREE = ("progress", "speed", "clock_rate", "script_speed", "x", "y", "yaw", "s", "slope", "half_length", "gap")
"""Columns of which one number is replaced by a bad one."""


def draw_path(rng: np.random.Generator) -> MotionPath:
    """A path of some metres; of a replay with a halt in it."""
    steps, is_timed = rng.uniform(0.1, 4.0, (rng.integers(1, 8), 2)), bool(rng.integers(2))
    if is_timed:
        steps[rng.integers(len(steps))] = 0.0
    xy = np.concatenate((rng.uniform(-4.0, 4.0, (1, 2)), steps)).cumsum(axis=0) * rng.choice((-1.0, 1.0), 2)
    s = np.append(0.0, np.hypot(*np.diff(xy, axis=0).T).cumsum())
    progress = np.round(rng.integers(0, 2) + 0.5 * np.arange(len(s)), 2) if is_timed else s
    return MotionPath(progress, s, xy[:, 0], xy[:, 1], rng.normal(0.0, 2.0, len(s)), is_timed)


def draw_movers(rng: np.random.Generator, count: int, bad: float | None) -> tuple[Rows, Rows]:
    """Movers in a narrow place, and the knots of their paths."""
    movers, paths = np.zeros(count, MOVER), [draw_path(rng) for _ in range(count)]
    knots = set_paths(movers, paths)
    for mover, path in zip(movers, paths, strict=True):
        kind = Kind(rng.integers(0, 3))
        for name in ("accel", "comfort_brake", "max_brake", "gap", "look_margin", "clearance", "prediction_s"):
            mover[name] = getattr(LIMITS_BY_KIND[kind], name)
        mover["is_timed"], mover["is_pedestrian"] = path.is_timed, kind == Kind.PEDESTRIAN
        for name in ("avoids_collisions", "is_present"):
            mover[name] = rng.random() < 0.9
        for name in ("stays_at_end", "is_braking", "is_stopped"):
            mover[name] = rng.integers(2)
        mover["half_length"], mover["half_width"] = rng.uniform(0.2, 2.5), rng.uniform(0.2, 1.0)
        on_knot = rng.choice(path.progress) + rng.choice((0.0, 1e-9, -1e-12))
        mover["progress"] = rng.choice((rng.uniform(-0.5, path.progress[-1] + 0.5), on_knot, TICK * DT))
        mover["speed"] = rng.choice((0.0, 0.05, 4.0)) * rng.random()
        mover["clock_rate"] = rng.choice((1.0, 0.3))
        mover["script_speed"] = rng.choice((INF, 0.0, 1e-7, 5.0))
    present = movers["is_present"].copy()
    movers = compiled.REFERENCES["actors_movers_place_movers"](movers, knots)
    movers["is_present"] = present
    if bad is not None and count:
        movers[str(rng.choice(FREE))][rng.integers(count)] = bad
    return movers, knots


@given(SEEDS, st.integers(0, 6), BAD)
def test_motion(seed: int, count: int, bad: float | None) -> None:
    rng = np.random.default_rng(seed)
    movers, knots = draw_movers(rng, count, bad)
    limits = rng.choice((INF, 0.0, 3.0), count)
    compare_twins("actors_movers_place_movers", compare_twins("actors_movers_advance_movers", movers, limits), knots)


@given(SEEDS, st.integers(0, 8), st.integers(0, 3), st.integers(0, 6), BAD)
def test_speed_limits(seed: int, count: int, cavs: int, others: int, bad: float | None) -> None:
    """Among movers, CAVs, static actors and background vehicles, some of them in the way of one another."""
    rng = np.random.default_rng(seed)
    movers, knots = draw_movers(rng, count, bad)
    egos = tuple(EgoState(*rng.normal(0.0, 5.0, 4).tolist()) for _ in range(cavs))
    x, y, yaw, speed = rng.normal(0.0, 5.0, (4, count + others))
    for column, name in ((x, "x"), (y, "y"), (yaw, "yaw"), (speed, "speed")):
        column[:count] = movers[name]
    if bad is not None and others:
        (x, yaw, speed)[rng.integers(3)][-1] = bad
    kind = rng.integers(0, 4, count + others).astype(np.uint8)
    length, width = rng.uniform(0.4, 5.0, count + others), rng.uniform(0.4, 2.0, count + others)
    ids = tuple(f"a{i}" for i in range(count + others))
    index_by_id = {f"a{i}": i for i in range(count)} | {f"a{i}": STATIC for i in range(count, count + others, 2)}
    actors = Actors(ids, kind, x, y, yaw, speed, length, width)
    name = "actors_collision_avoidance_compute_speed_limits"
    compare_twins(name, movers, knots, TICK, egos, actors, index_by_id)


@pytest.mark.parametrize(
    ("y_other", "yaw", "proceeds"), [(0.0, math.pi, False), (-1.2, 2.5, True), (1.2, -2.4, True), (0.0, 0.0, False)]
)
def test_the_first_of_two_actors_that_wait_for_each_other_proceeds_unless_they_meet_head_on(
    y_other: float, yaw: float, proceeds: bool
) -> None:
    lines = [(0.0, 0.0, 0.0), (4.8, y_other, yaw)]
    paths: list[MotionPath] = []
    for x, y, heading in lines:
        s = np.linspace(0.0, 20.0, 9)
        line = x + s * math.cos(heading), y + s * math.sin(heading)
        paths.append(MotionPath(s, s, line[0], line[1], np.full(9, heading)))
    movers = np.zeros(2, MOVER)
    knots = set_paths(movers, paths)
    movers["half_length"], movers["half_width"], movers["avoids_collisions"], movers["is_present"] = 2.2, 0.9, 1, 1
    movers["gap"], movers["look_margin"], movers["comfort_brake"] = 2.0, 2.0, 3.0
    for name, column in zip(("x", "y", "yaw"), zip(*lines, strict=True), strict=True):
        movers[name] = column
    x, y, heading, speed = (movers[name] for name in ("x", "y", "yaw", "speed"))
    length, width = 2 * movers["half_length"], 2 * movers["half_width"]
    actors = Actors(("a", "b"), np.zeros(2, np.uint8), x, y, heading, speed, length, width)
    name = "actors_collision_avoidance_compute_speed_limits"
    limits = compare_twins(name, movers, knots, TICK, (), actors, {"a": 0, "b": 1})
    assert (limits[0] == INF) == proceeds


def test_movers_without_paths_are_refused() -> None:
    movers, knots = draw_movers(np.random.default_rng(0), 2, None)
    place = get_compiled("actors_movers_place_movers")
    for first, last in ((-1, 1), (1, 1), (0, len(knots))):
        movers["first"][1], movers["last"][1] = first, last
        with pytest.raises(ValueError, match="expected a path of two knots or more"):
            place(movers, knots)
    with pytest.raises(ValueError, match="expected a speed limit for each mover"):
        get_compiled("actors_movers_advance_movers")(movers, np.zeros(3))
    with pytest.raises(TypeError, match="expected rows"):
        place(np.zeros(2, KNOT), knots)


def test_an_index_of_no_mover_is_refused() -> None:
    movers, knots = draw_movers(np.random.default_rng(0), 1, None)
    actor = Actors(("a",), np.zeros(1, np.uint8), *np.ones((6, 1)))
    with pytest.raises(ValueError, match="expected an index of a mover"):
        get_compiled("actors_collision_avoidance_compute_speed_limits")(movers, knots, TICK, (), actor, {"a": 1})
