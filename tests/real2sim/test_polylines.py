"""Projections onto polylines have the bits of GEOS, which walks along each of them for each point."""

from typing import Any

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mdrive_sumo.core.geometry import Float, Polyline
from real2sim.polylines import PolylineIndex
from real2sim.segment_tree import SegmentTree

COORDINATES = st.one_of(st.integers(-4, 4).map(float), st.integers(-(10**9), 10**9).map(lambda n: n / 3e7))
"""[m] Points of a polyline are equal or at least 30 nm apart: GEOS has no distance from a shorter segment."""
LINES = st.lists(st.integers(2, 7).flatmap(lambda n: arrays(np.float64, (n, 2), elements=COORDINATES)), max_size=4)
POINTS = st.integers(0, 5).flatmap(lambda n: arrays(np.float64, (n, 2), elements=COORDINATES))
OFFSETS = st.sampled_from((0.0, 123_456.7, -900_000.0))


@settings(max_examples=25)
@given(lines=LINES, xy=POINTS, offset=OFFSETS, reach=st.sampled_from((0.5, 2.0, 20.0)))
def test_projections_are_those_of_geos(lines: list[Float], xy: Float, offset: float, reach: float) -> None:
    lines, xy = [line + offset for line in lines], xy + offset
    xy = np.concatenate([xy, *(line[:1] for line in lines), *(line[-1:] for line in lines)])
    drawn = np.array([shapely.LineString(line) for line in lines], dtype=object)
    points: Any = shapely.points(xy)
    found = PolylineIndex([Polyline(line) for line in lines]).project_points(xy, reach)

    expected = sorted(zip(*shapely.STRtree(drawn).query(points, predicate="dwithin", distance=reach), strict=True))
    assert list(zip(found.point, found.line, strict=True)) == expected
    pairs: Any = points[found.point], drawn[found.line]
    s = shapely.line_locate_point(pairs[1], pairs[0])
    assert found.s.tolist() == s.tolist()
    gap = shapely.get_coordinates(shapely.line_interpolate_point(pairs[1], s)).reshape(-1, 2) - xy[found.point]
    cos, sin = np.cos(found.yaw), np.sin(found.yaw)
    assert found.longitudinal.tolist() == (gap[:, 0] * cos + gap[:, 1] * sin).tolist()
    assert found.lateral.tolist() == (gap[:, 1] * cos - gap[:, 0] * sin).tolist()


@settings(max_examples=60)
@given(lines=LINES, xy=POINTS, offset=OFFSETS, reach=st.floats(0.0, 40.0))
def test_near_segments_are_those_of_geos(lines: list[Float], xy: Float, offset: float, reach: float) -> None:
    segments, xy = SegmentTree.from_lines([line + offset for line in lines]), xy + offset
    points: Any = shapely.points(xy)
    reaches = reach + np.arange(float(len(xy)))
    found = segments.find_near(xy, reaches)
    expected = segments.tree.query(points, predicate="dwithin", distance=reaches) if len(xy) else ((), ())
    assert sorted(zip(found.point, found.segment, strict=True)) == sorted(zip(*expected, strict=True))
    distance = shapely.distance(points[found.point], segments.tree.geometries[found.segment])
    assert found.distance.tolist() == distance.tolist()


def test_lines_of_one_point_have_no_segment() -> None:
    segments = SegmentTree.from_lines([np.zeros((1, 2)), np.zeros((0, 2)), np.array(((0.0, 0.0), (4.0, 0.0)))])
    assert segments.line.tolist() == [2]
    assert [part.tolist() for part in segments.find_nearest(np.array(((1.0, 3.0),)))] == [[0], [0], [3.0]]
