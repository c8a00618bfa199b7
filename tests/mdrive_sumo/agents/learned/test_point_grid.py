"""The compiled point grid against the Python text; hand-made points stand in tests/mdrive_sumo/learning."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.agents.learned.fusion_spec import GRID_REACH_M
from mdrive_sumo.agents.learned.point_grid import build_point_cells, count_points, find_points_inside

EDGES = np.array((-2.2, -1.8, -1.4, -0.9, -0.5, 0.3, 1.5), np.float32)
PLACES = st.one_of(
    st.floats(-60.0, 60.0, width=32),
    st.integers(-129, 129).map(lambda cell: float(np.float32(cell * 0.4))),
    st.sampled_from((GRID_REACH_M, -GRID_REACH_M, float("nan"), float("inf"))),
)
HEIGHTS = st.one_of(st.floats(-3.0, 5.0, width=32), st.sampled_from([*EDGES.tolist(), float("nan")]))


@given(points=st.lists(st.tuples(PLACES, PLACES, HEIGHTS), max_size=12), copies=st.sampled_from((1, 300)))
def test_both_texts_find_the_same_cells(points: list[tuple[float, float, float]], copies: int) -> None:
    array = np.array(points * copies, np.float32).reshape(-1, 3)
    cells = compare_twins("agents_learned_point_grid_count_points", array, EDGES)
    assert (np.diff(cells) > 0).all() and (cells & 255 > 0).all()
    inside = find_points_inside(array)
    assert len(build_point_cells(array[~inside])) == 0 and (not inside.any()) == (not len(cells))


def test_points_without_height_are_refused() -> None:
    with pytest.raises((ValueError, IndexError), match=r"expected points|out of bounds"):
        count_points(np.zeros((3, 2), np.float32), EDGES)
