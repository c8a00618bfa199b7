"""Footprints along paths and their overlaps."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.parameters import MARGINS
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, compute_path_overlaps
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath, build_path

REAR = 1.42
STRAIGHT = np.column_stack((np.arange(61.0), np.zeros(61)))
SIZE = (4.9, 2.0)


def straight_path() -> ReferencePath:
    return build_path(STRAIGHT, REAR)


@given(st.data())
def test_overlaps_agree_with_shapely(data: st.DataObject) -> None:
    rows = st.lists(st.tuples(*[st.integers(-60, 60)] * 2, st.floats(-3.1, 3.1)), min_size=1, max_size=4)
    sides = [np.array(data.draw(rows)) for _ in range(2)]
    mine, others = (_corners(side) for side in sides)
    expected = [[_shared_area(a, b) for b in others] for a in mine]
    found = compute_overlaps(mine, others)
    for i, row in enumerate(expected):
        for j, area in enumerate(row):
            if not 0.0 < area < 1e-6:  # a touch is decided by rounding
                assert found[i, j] == (area > 0.0)


def _corners(rows: Float) -> Float:
    boxes = [
        shapely.affinity.rotate(
            shapely.box(x / 10 - 2.45, y / 10 - 1, x / 10 + 2.45, y / 10 + 1), yaw, use_radians=True
        )
        for x, y, yaw in rows
    ]
    return np.array([shapely.get_coordinates(box)[:4] for box in boxes])


def _shared_area(a: Float, b: Float) -> float:
    return float(shapely.Polygon(a).intersection(shapely.Polygon(b)).area)


def test_a_path_overlaps_itself_within_a_car_length() -> None:
    path = straight_path()
    met = compute_path_overlaps(path, path, SIZE, MARGINS.contact)
    apart = np.abs(np.subtract.outer(np.arange(len(met)), np.arange(len(met)))) * SPACING_M
    assert np.array_equal(met, apart < 4.9 + MARGINS.contact.longitudinal)


def test_footprints_are_where_the_path_is() -> None:
    corners = compute_footprints(straight_path(), *SIZE, np.array([40]))
    assert corners[0].mean(0) == pytest.approx((10.0, 0.0), abs=0.01)
    assert np.ptp(corners[0], axis=0) == pytest.approx(SIZE, abs=0.01)
