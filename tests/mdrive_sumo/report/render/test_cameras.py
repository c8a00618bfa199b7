"""Cameras against independent formulas: the ray through a pixel hits the point, and areas are cut at the near plane."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mdrive_sumo.report.render.cameras import FAR_M, NEAR_M, PerspectiveCamera, Rings, TopCamera, build_rings, lift

METRES = st.floats(-200, 200)
CAMERAS = st.builds(
    PerspectiveCamera,
    *(METRES, METRES, st.floats(1, 30), st.floats(-10, 10), st.floats(-0.4, 1.2), st.floats(200, 2000)),
    width=st.just(640),
    height=st.just(360),
)
POINTS = st.tuples(METRES, METRES, st.floats(0, 20))


def cast_ray(camera: PerspectiveCamera, pixel: tuple[float, float]) -> Any:
    """The unit vector from the camera through a pixel, by rotations of the camera from a level view along +x."""
    right, down = pixel[0] - camera.width / 2, pixel[1] - camera.height / 2
    turn = Rotation.from_euler("z", camera.yaw) * Rotation.from_euler("y", camera.pitch)
    ray = turn.apply((camera.focal_px, -right, -down))
    return ray / np.linalg.norm(ray)


def find_horizon(camera: PerspectiveCamera) -> float:
    """The row of the picture in which level ground ends, however far it reaches."""
    return camera.height / 2 - camera.focal_px * math.tan(camera.pitch)


def split(rings: Rings) -> dict[int, Any]:
    """The points of each ring that has any, by its number."""
    return {int(number): rings.points[rings.ring == number] for number in np.unique(rings.ring)}


@given(CAMERAS, POINTS)
def test_the_ray_through_a_points_pixel_hits_the_point(
    camera: PerspectiveCamera, point: tuple[float, float, float]
) -> None:
    relative = np.array(point) - (camera.x, camera.y, camera.z)
    depth = relative @ cast_ray(camera, (camera.width / 2, camera.height / 2))
    pixel = camera.find_pixel(point)
    if abs(depth - NEAR_M) > 1e-6:
        assert (pixel is None) == (depth < NEAR_M)
    if pixel is not None:
        ray = cast_ray(camera, pixel)
        assert np.allclose(ray * np.linalg.norm(relative), relative, atol=1e-6 * np.linalg.norm(relative))


@given(CAMERAS)
def test_level_points_far_away_are_at_the_horizon(camera: PerspectiveCamera) -> None:
    far = 1e7
    pixel = camera.find_pixel((camera.x + far * math.cos(camera.yaw), camera.y + far * math.sin(camera.yaw), camera.z))
    assert pixel is not None
    assert pixel == pytest.approx((camera.width / 2, find_horizon(camera)), abs=1e-2)


@given(METRES, METRES, st.floats(0.5, 40), POINTS)
def test_the_top_camera_is_a_map_with_north_up(x: float, y: float, scale: float, point: Any) -> None:
    px, py = TopCamera(x, y, scale, 640, 360).find_pixel(point)
    assert (px, py) == pytest.approx((320 + scale * (point[0] - x), 180 - scale * (point[1] - y)), abs=1e-6)


OUTLINES = st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=3, max_size=12)


def sort_around_middle(points: list[tuple[float, float]]) -> shapely.Polygon:
    """A polygon without crossings of itself, seldom convex."""
    x, y = (math.fsum(column) / len(points) for column in zip(*points, strict=True))

    def find_angle(point: tuple[float, float]) -> tuple[float, float, float]:
        return math.atan2(point[1] - y, point[0] - x), *point

    return shapely.Polygon(sorted(points, key=find_angle))


def shoelace(ring: Any) -> float:
    x, y = ring[:, 0], ring[:, 1]
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@given(st.lists(OUTLINES.map(sort_around_middle).filter(lambda shape: shape.is_valid and shape.area > 1), max_size=4))
def test_clipping_keeps_what_is_on_the_right_side(shapes: list[shapely.Polygon]) -> None:
    """Against shapely: the area of each polygon beyond x = 10, and never a point on the wrong side."""
    rings = build_rings(shapes)
    kept = rings.clip(rings.points[:, 0] - 10.0)
    area = dict.fromkeys(range(len(shapes)), 0.0)
    area |= {number: shoelace(ring) for number, ring in split(kept).items()}
    side = shapely.box(10, -1e3, 1e3, 1e3)
    assert list(area.values()) == pytest.approx([shape.intersection(side).area for shape in shapes], abs=1e-6)
    assert (kept.points[:, 0] >= 10.0 - 1e-9).all()


def test_holes_stay_holes() -> None:
    shape = shapely.Point(0, 0).buffer(20).difference(shapely.Point(0, 0).buffer(5))
    rings = build_rings([shape])
    kept = rings.clip(rings.points[:, 1])
    assert sum(map(shoelace, split(kept).values())) == pytest.approx(shape.area / 2, rel=1e-9)


CAMERA = PerspectiveCamera(0, 0, 5, 0, math.radians(12), 500, 640, 360)


def test_ground_below_and_behind_the_camera_is_cut_off() -> None:
    """Without clipping what lies behind would appear upside down above the horizon."""
    ground = build_rings([shapely.box(-100, -100, 100, 100)])
    seen = CAMERA.project(ground)
    assert len(seen.points) and np.isfinite(seen.points).all()
    assert seen.points[:, 1].min() > find_horizon(CAMERA)
    assert seen.points[:, 1].max() > CAMERA.height  # it reaches below the picture
    assert np.abs(seen.points[:, 0] - 320).max() <= 1.06 * 320  # and a little beyond its sides


@pytest.mark.parametrize("x", [-60.0, FAR_M + 30.0])
def test_nothing_behind_or_beyond_is_seen(x: float) -> None:
    assert not len(CAMERA.project(build_rings([shapely.box(x - 10, -5, x + 10, 5)])).points)


@given(POINTS, POINTS)
def test_a_segment_ends_at_the_near_plane(a: Any, b: Any) -> None:
    depth = CAMERA.to_camera(np.array((a, b)))[:, 2]
    seen = CAMERA.project_segment(np.array((a, b)))
    if (depth < NEAR_M).all():
        assert seen is None
        return
    assert seen is not None and np.isfinite(seen).all()
    for end, point, at in zip(seen, (a, b), depth, strict=True):
        if at >= NEAR_M:
            assert tuple(end) == pytest.approx(CAMERA.find_pixel(point))


def test_no_rings_are_no_rings() -> None:
    none = build_rings([])
    assert not len(none.points) and not len(CAMERA.project(none).points)
    assert lift(np.zeros((2, 2)), 3.0).tolist() == [[0, 0, 3], [0, 0, 3]]
    assert Rings.concat([np.zeros((3, 2)), np.ones((4, 2))]).starts.tolist() == [0, 3]
