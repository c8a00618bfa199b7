"""End criteria: the same progress from the Python text and from the compiled layer."""

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
