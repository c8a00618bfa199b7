"""The pinhole against rotations of scipy, and OpenGL's clip space against the pinhole."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.sensing.camera.camera_model import FAR_PLANE_M, NEAR_PLANE_M, CameraModel, CameraMount, ImageKind

ANGLES = st.floats(-3.1, 3.1)
PLACES = st.floats(-500.0, 500.0)
MOUNTS = st.builds(CameraMount, *(st.floats(-3.0, 3.0),) * 2, st.floats(0.2, 50.0), *(st.floats(-1.5, 1.5),) * 3)
MODELS = st.builds(
    CameraModel, st.just(ImageKind.RGB), st.integers(16, 1600), st.integers(16, 900), st.floats(20.0, 150.0), MOUNTS
)


@given(MODELS, PLACES, PLACES, ANGLES, st.floats(1.0, 300.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_a_point_is_where_the_ray_through_its_pixel_goes(
    model: CameraModel, x: float, y: float, yaw: float, depth: float, aside: float, up: float
) -> None:
    from scipy.spatial.transform import Rotation

    mount = model.mount
    body = Rotation.from_euler("Z", yaw)
    camera = body * Rotation.from_euler("ZYX", (mount.yaw, mount.pitch, mount.roll))
    place = np.array((x, y, 0.0)) + body.apply((mount.x, mount.y, mount.z))
    point = place + camera.apply((depth, aside * depth, up * depth))
    column, row, found = model.project(model.find_view(x, y, yaw), point)
    focal = model.width / 2 / math.tan(math.radians(model.fov_deg) / 2)
    assert found == pytest.approx(depth, abs=1e-6)
    assert column == pytest.approx(model.width / 2 - focal * aside, abs=1e-4)
    assert row == pytest.approx(model.height / 2 - focal * up, abs=1e-4)


@given(MODELS, PLACES, PLACES, ANGLES, st.floats(0.5, 150.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_what_a_pixel_shows_is_never_left_out(
    model: CameraModel, x: float, y: float, yaw: float, depth: float, across: float, down: float
) -> None:
    """Points of every pixel up to 12 m above the ground, each with a disc of 3 m around it."""
    view = model.find_view(x, y, yaw)
    aside = (model.width / 2 - across * model.width) / model.focal_px
    up = (model.height / 2 - down * model.height) / model.focal_px
    point = view.place + view.axes @ (depth, aside * depth, up * depth)
    if 0.0 <= point[2] <= 12.0:
        assert model.may_show(view, point[None, :2], np.array((3.0,)))[0]


@given(MODELS, PLACES, PLACES, ANGLES, st.floats(0.2, 900.0), st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))
def test_clip_space_is_the_pinhole(
    model: CameraModel, x: float, y: float, yaw: float, depth: float, aside: float, up: float
) -> None:
    view, origin = model.find_view(x, y, yaw), np.array((100.0, -50.0, 0.0))
    point = view.place + view.axes @ (depth, aside * depth, up * depth)
    clip = model.build_clip_matrix(view, origin) @ (*(point - origin), 1.0)
    across, down, behind = clip[:3] / clip[3]
    column, row, _ = model.project(view, point)
    assert (across + 1) / 2 * model.width == pytest.approx(column, abs=1e-3)
    assert (down + 1) / 2 * model.height == pytest.approx(row, abs=1e-3)
    near, far = NEAR_PLANE_M, FAR_PLANE_M
    assert behind == pytest.approx((far + near - 2 * far * near / depth) / (far - near), abs=1e-9)
