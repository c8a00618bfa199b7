"""Poses on reference lines of OpenDRIVE, against closed forms."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from testing.opendrive_samples import NORMALIZED, SPIRAL, format_geometry, format_map, format_road

from mdrive_sumo.core.errors import InputError
from real2sim.carla.reference_line import compute_pose


@pytest.mark.parametrize(
    ("shape", "length", "s", "wanted"),
    [
        ("<line/>", 100, 40, (40, 0, 0)),
        ('<arc curvature="0.02"/>', 100, 50 * math.pi / 2, (50, 50, math.pi / 2)),
        ('<spiral curvStart="0.02" curvEnd="0.02"/>', 100, 50 * math.pi / 2, (50, 50, math.pi / 2)),
        # Euler's spiral of 1 m with the curvature pi at its end: the Fresnel integrals C(1) and S(1)
        (f'<spiral curvStart="0" curvEnd="{math.pi * 100}"/>', 0.01, 0.01, (0.007798934, 0.004382591, math.pi / 2)),
        ('<poly3 a="0" b="0.75" c="0" d="0"/>', 100, 50, (40, 30, math.atan(0.75))),
        ('<paramPoly3 aU="0" bU="80" cU="0" dU="0" aV="0" bV="60" cV="0" dV="0"/>', 100, 50, (40, 30, math.atan(0.75))),
        (
            '<paramPoly3 pRange="arcLength" aU="0" bU="0.8" cU="0" dU="0" aV="0" bV="0.6" cV="0" dV="0"/>',
            100,
            50,
            (40, 30, math.atan(0.75)),
        ),
    ],
)
def test_poses_of_every_shape(
    tmp_path: Path, shape: str, length: float, s: float, wanted: tuple[float, float, float]
) -> None:
    text = format_map(format_road(geometry=format_geometry(shape, length), length=length))
    (road,) = ElementTree.fromstring(text.partition("?>")[2]).iter("road")
    np.testing.assert_allclose(compute_pose(tmp_path, road, s), wanted, atol=2e-6)


@pytest.mark.parametrize("shape", [SPIRAL, NORMALIZED, '<arc curvature="0.02"/>'])
def test_a_pose_turned_and_moved_is_that_of_the_piece(tmp_path: Path, shape: str) -> None:
    road = ElementTree.fromstring(format_road(geometry=format_geometry(shape, x=7, y=9, hdg=1)))
    plain = ElementTree.fromstring(format_road(geometry=format_geometry(shape)))
    x, y, yaw = compute_pose(tmp_path, plain, 60)
    expected = (7 + x * math.cos(1) - y * math.sin(1), 9 + x * math.sin(1) + y * math.cos(1), yaw + 1)
    np.testing.assert_allclose(compute_pose(tmp_path, road, 60), expected)


@pytest.mark.parametrize(
    ("shape", "name"),
    [
        ('<arc curvature="1e300"/>', "curvature"),
        ('<spiral curvStart="0" curvEnd="1e300"/>', "curvEnd"),
        ('<poly3 a="0" b="0" c="1e300" d="0"/>', "c"),
        ('<paramPoly3 aU="0" bU="1" cU="0" dU="1e308" aV="0" bV="0" cV="0" dV="0"/>', "dU"),
        ('<paramPoly3 aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="0" dV="-1e308"/>', "dV"),
    ],
)
def test_numbers_whose_places_overflow_are_refused_before_they_are_used(tmp_path: Path, shape: str, name: str) -> None:
    road = ElementTree.fromstring(format_road(geometry=format_geometry(shape, 100), length=100))
    with pytest.raises(InputError, match=rf"{name}: expected a number within 1e\+08, found -?1e\+30"):
        compute_pose(tmp_path, road, 50)
