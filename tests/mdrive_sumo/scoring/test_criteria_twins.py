"""End criteria: the same progress from the Python text and from the compiled layer."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.scoring.criteria import RouteProgress, RouteReference

ANY = st.floats(allow_nan=True, allow_infinity=True)
PLACE = st.one_of(st.floats(-40.0, 40.0), st.integers(-9, 9).map(float), ANY)
ROUTES = st.integers(1, 12).flatmap(
    lambda points: st.builds(RouteReference, *[st.lists(PLACE, min_size=points, max_size=points).map(tuple)] * 5)
)


@st.composite
def courses(draw: st.DrawFn) -> tuple[RouteReference, RouteProgress]:
    route = draw(ROUTES)
    points = st.integers(0, len(route.x) - 1)
    arrived = st.one_of(st.none(), st.integers(0, 99))
    progress = st.builds(RouteProgress, points, arrived, points, st.floats(0, 50), st.booleans(), st.integers(0, 99))
    return route, draw(progress)


@given(courses(), st.integers(0, 999), PLACE, PLACE, st.one_of(st.floats(-2.0, 2.0), ANY))
def test_progress(course: tuple[RouteReference, RouteProgress], tick: int, x: float, y: float, speed: float) -> None:
    route, progress = course
    compare_twins("scoring_criteria_update_progress", progress, route, tick, x, y, speed)
    compare_twins("scoring_criteria_advance_index", route, progress.passed, tick % 9, x, y)


@given(ROUTES, st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), max_size=6))
def test_progress_of_several_ticks(route: RouteReference, steps: list[tuple[float, float]]) -> None:
    progress = RouteProgress()
    for tick, (dx, dy) in enumerate(steps):
        x, y = route.x[tick % len(route.x)] + dx, route.y[tick % len(route.y)] + dy
        found = compare_twins("scoring_criteria_update_progress", progress, route, tick, x, y, 1.0)
        progress = found if isinstance(found, RouteProgress) else progress


def test_progress_at_the_limits() -> None:
    """Places beside a straight route with points every 2 m, about as far from it as the limits are."""
    s = np.arange(0.0, 61.0, 2.0)
    route = RouteReference(*(tuple(column.tolist()) for column in (s, 0 * s, 1 + 0 * s, 0 * s, s)))
    rng = np.random.default_rng(0)
    for _ in range(1500):
        passed, nearest = rng.integers(0, len(s), 2).tolist()
        progress = RouteProgress(passed, None, nearest, float(rng.uniform(10.0, 20.0)))
        x, aside = (
            s[nearest] + rng.uniform(-1.0, 15.0),
            rng.choice((0.0, 9.0, 10.0, 15.0, 30.0)) + rng.uniform(0.0, 1.0),
        )
        speed = float(rng.choice((0.49, -0.5, 0.5, 0.51)))
        compare_twins("scoring_criteria_update_progress", progress, route, 9, float(x), float(aside), speed)


def test_a_route_of_a_hundred_points_is_complete_after_99_percent() -> None:
    s = np.arange(101.0)
    route = RouteReference(*(tuple(column.tolist()) for column in (s, 0 * s, 1 + 0 * s, 0 * s, s)))
    for passed in range(95, 101):
        for x in (89.7, 90.1, 99.5):
            compare_twins("scoring_criteria_update_progress", RouteProgress(passed), route, 9, x, 0.0, 1.0)
