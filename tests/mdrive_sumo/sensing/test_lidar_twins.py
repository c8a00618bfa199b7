"""The compiled LiDAR against the Python text."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.sensing.lidar_cast import LidarBoxes, LidarWalls, cast_rays, pack_keys
from mdrive_sumo.sensing.lidar_rays import LidarRays, build_tilted_rays, build_upright_rays, compute_elevations
from mdrive_sumo.sensing.lidar_sensor import NOTHING, build_points

UPRIGHT = build_upright_rays(48, compute_elevations(16, -30.0, 10.0))
LEANING = build_tilted_rays(24, compute_elevations(8, -30.0, 30.0), 0.3, -0.2)
RAYS = st.sampled_from((UPRIGHT, LEANING))
PLACES = st.one_of(st.integers(-9, 9).map(float), st.floats(-40.0, 40.0))
ROW = st.tuples(
    PLACES, PLACES, st.one_of(st.floats(-9.0, 9.0), st.sampled_from((0.0, math.pi, 1e9))),
    st.floats(0.0, 12.0), st.floats(0.0, 3.0), st.sampled_from((-1.0, -0.2, 0.0, 1.5)),
)  # fmt: skip
WALL = st.tuples(PLACES, PLACES, PLACES, PLACES)
HEIGHT_M = 2.5


def boxes(rows: list[tuple[float, ...]]) -> LidarBoxes:
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return LidarBoxes(*table.T, owner=np.arange(1, len(rows) + 1))


def walls(rows: list[tuple[float, ...]]) -> LidarWalls:
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return LidarWalls(table[:, :2], table[:, 2:], 7.5, np.arange(50, 50 + len(rows)))


def ground(rays: LidarRays) -> Float:
    distance = HEIGHT_M / np.maximum(-rays.slope, 1e-9)
    return np.where(distance < 60.0, pack_keys(distance, np.array(0)), pack_keys(distance, np.array(NOTHING)))


@given(rays=RAYS, rows=st.lists(ROW, max_size=6), sides=st.lists(WALL, max_size=6))
def test_any_scene(rays: LidarRays, rows: list[tuple[float, ...]], sides: list[tuple[float, ...]]) -> None:
    compare_twins("sensing_lidar_cast_cast_rays", rays, boxes(rows), walls(sides), HEIGHT_M, ground(rays))


@given(rays=RAYS, row=st.tuples(*[st.sampled_from((math.nan, -0.0, 3.0))] * 6))
def test_boxes_that_mean_nothing(rays: LidarRays, row: tuple[float, ...]) -> None:
    compare_twins("sensing_lidar_cast_cast_rays", rays, boxes([row]), walls([]), HEIGHT_M, ground(rays))


@pytest.mark.parametrize(
    ("rows", "keys"), [((np.zeros((2, 2)), np.zeros((1, 2))), 768), ((np.zeros((1, 2)), np.zeros((1, 2))), 767)]
)
def test_arrays_that_do_not_fit_are_refused(rows: tuple[Float, Float], keys: int) -> None:
    bad = LidarWalls(*rows, 7.5, np.zeros(1, np.int64))
    with pytest.raises(ValueError, match="expected a"):
        cast_rays(UPRIGHT, boxes([]), bad, HEIGHT_M, ground(UPRIGHT)[:keys])


SEEDS = st.integers(0, 2**32 - 1)


@given(seed=SEEDS, drops=st.booleans(), is_noisy=st.booleans())
def test_points(seed: int, drops: bool, is_noisy: bool) -> None:
    rng, rays = np.random.default_rng(seed), len(UPRIGHT.order)
    owner = rng.choice((0, 1, 2, NOTHING), rays)
    keys = pack_keys(rng.uniform(0.0, 90.0, rays), owner)
    kept = rng.random(rays) < 0.7 if drops else np.zeros(0, np.bool_)
    noise_m = rng.normal(0.0, 30.0, rays if is_noisy else 0).astype(np.float32)
    reflectivity = np.array((0.2, 0.5, 0.8), np.float32)
    points, owners = compare_twins("sensing_lidar_sensor_build_points", UPRIGHT, keys, kept, noise_m, reflectivity)
    assert points.shape == (len(owners), 4)


def test_an_owner_without_reflectivity_is_refused() -> None:
    with pytest.raises(ValueError, match="a reflectivity for each owner"):
        none = np.zeros(0)
        build_points(UPRIGHT, ground(UPRIGHT), none.astype(bool), none.astype(np.float32), none.astype(np.float32))
