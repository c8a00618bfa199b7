"""The nearest of many lines: shapely is the independent judge, and both twins have the same bits."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.core.geometry import Polyline, build_polyline
from mdrive_sumo.roads.lane_search import build_line_segments, find_nearest_lines

COORDINATES = st.one_of(st.floats(-20.0, 20.0).map(lambda metres: round(metres, 6)), st.integers(-3, 3).map(float))
"""Without lengths whose squares vanish, for which shapely knows no distance."""
POINTS = st.tuples(COORDINATES, COORDINATES)
LINES = st.lists(st.lists(POINTS, min_size=2, max_size=5).map(np.array).map(Polyline), min_size=1, max_size=5)


@given(LINES, st.lists(POINTS, max_size=5))
def test_the_nearest_line_is_that_of_shapely(lines: list[Polyline], points: list[tuple[float, float]]) -> None:
    segments, xy = build_line_segments(lines), np.array(points).reshape(-1, 2)
    nearest, distance, row = compare_twins("roads_lane_search_find_nearest_lines", segments.rows, segments.first, xy)
    for i, point in enumerate(points):
        distances = [shapely.Point(point).distance(shapely.LineString(line.xy)) for line in lines]
        assert distance[i] == pytest.approx(min(distances), abs=1e-9)
        assert distance[i] == pytest.approx(distances[nearest[i]], abs=1e-9)
        assert segments.first[nearest[i]] <= row[i] < segments.first[nearest[i] + 1]


def test_of_equally_near_lines_the_first_and_of_segments_that_meet_the_second() -> None:
    bend, beside = build_polyline([(0, 0), (4, 0), (4, 4)]), build_polyline([(0, 2), (4, 2)])
    segments = build_line_segments([bend, beside, bend])
    line, distance, row = find_nearest_lines(segments.rows, segments.first, np.array(((1.0, 1.0), (5.0, -1.0))))
    assert line.tolist() == [0, 0]
    assert distance.tolist() == [1.0, 2.0**0.5]
    assert segments.yaw[row].tolist() == [0.0, np.pi / 2]


def test_a_line_that_rounding_makes_the_nearest_is_looked_at() -> None:
    """By the formula the point lies on both lines; it is beyond the box of the second one by 4e-15 m."""
    joint = (5.25, 2.5)
    for end in ((6.25, 4.25), (28.847745716808973, 49.255484518419564)):
        segments = build_line_segments(
            [build_polyline([joint, end]), build_polyline([(-32.03022436673761, 62.734871585109005), joint])]
        )
        xy = np.array(((5.2500000000000036, 2.500000000000007),))
        line, _, _ = compare_twins("roads_lane_search_find_nearest_lines", segments.rows, segments.first, xy)
        assert line.tolist() == [1]


@pytest.mark.parametrize("xy", [np.array(((np.nan, 0.0),)), np.array(((0.0, np.inf),))])
def test_a_point_that_is_nowhere_is_refused(xy: np.ndarray) -> None:
    segments = build_line_segments([build_polyline([(0, 0), (1, 0)])])
    with pytest.raises(ValueError, match="finite points"):
        find_nearest_lines(segments.rows, segments.first, xy)
    for first in ((0,), (0, 2), (1, 1), (0, 0, 1)):
        with pytest.raises(ValueError, match="segments of one line"):
            get_compiled("roads_lane_search_find_nearest_lines")(segments.rows, np.array(first), xy[:0])
