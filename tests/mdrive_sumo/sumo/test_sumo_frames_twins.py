"""Poses of SUMO: the same bits from the Python text and from the compiled layer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.core.state import Actors
from mdrive_sumo.sumo.sumo_frames import place_actors

ANY = st.floats(allow_nan=True, allow_infinity=True)
ANGLES = st.one_of(st.floats(0.0, 360.0), st.sampled_from((0.0, 90.0, 180.0, 270.0, 360.0, -90.0, 630.0)), ANY)
ROWS = st.lists(st.tuples(st.tuples(ANY, ANY), ANGLES, ANY, ANY), max_size=5)


@given(ROWS)
def test_poses(rows: list[tuple[tuple[float, float], float, float, float]]) -> None:
    fronts, angles, speeds, lengths = ([row[i] for row in rows] for i in range(4))
    nothing, size = np.zeros(len(rows)), np.array(lengths, dtype=np.float64)
    ids, kind = tuple(map(str, range(len(rows)))), np.zeros(len(rows), dtype=np.uint8)
    template = Actors(ids, kind, nothing, nothing, nothing, nothing, size, nothing)
    compare_twins("sumo_sumo_frames_place_actors", template, fronts, angles, speeds)
    if rows:
        with pytest.raises(ValueError, match="expected a value for every actor"):
            get_compiled("sumo_sumo_frames_place_actors")(template, fronts[1:], angles, speeds)


def test_ids_and_sizes_stay_the_same_objects() -> None:
    one = np.ones(1)
    template = Actors(("a",), np.zeros(1, dtype=np.uint8), one, one, one, one, one, one)
    placed = place_actors(template, [(3.0, 4.0)], [90.0], [5.0])
    assert placed.ids is template.ids and placed.length is one
    assert (placed.x[0], placed.y[0], placed.yaw[0], placed.speed[0]) == (2.5, 4.0, 0.0, 5.0)
