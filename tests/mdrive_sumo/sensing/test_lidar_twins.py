"""The compiled LiDAR against the Python text."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.sensing.lidar_cast import MIDDLE, ROOF, HitKeys, LidarBoxes, LidarWalls, cast_rays, mark, pack_keys
from mdrive_sumo.sensing.lidar_rays import LidarRays, build_tilted_rays, build_upright_rays, compute_elevations
from mdrive_sumo.sensing.lidar_reflectivity import Reflectivities
from mdrive_sumo.sensing.lidar_returns import NOTHING, LidarOptics, build_points, compute_ground_strengths

UPRIGHT = build_upright_rays(48, compute_elevations(16, -30.0, 10.0))
LEANING = build_tilted_rays(24, compute_elevations(8, -30.0, 30.0), 0.3, -0.2)
RAYS = st.sampled_from((UPRIGHT, LEANING))
PLACES = st.one_of(st.integers(-9, 9).map(float), st.floats(-40.0, 40.0))
ROW = st.tuples(
    PLACES, PLACES, st.one_of(st.floats(-9.0, 9.0), st.sampled_from((0.0, math.pi, 1e9))),
    st.floats(0.0, 12.0), st.floats(0.0, 3.0), st.sampled_from((-2.5, -2.5, -0.5, 0.5)),
    st.sampled_from((-1.0, -0.2, 0.0, 1.5)),
)  # fmt: skip
WALL = st.tuples(PLACES, PLACES, PLACES, PLACES)
HEIGHT_M = 2.5


def boxes(rows: list[tuple[float, ...]]) -> LidarBoxes:
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return LidarBoxes(*table.T, owner=np.arange(1, len(rows) + 1))


def walls(rows: list[tuple[float, ...]]) -> LidarWalls:
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return LidarWalls(table[:, :2], table[:, 2:], 7.5, np.arange(50, 50 + len(rows)))


def ground(rays: LidarRays) -> HitKeys:
    distance = HEIGHT_M / np.maximum(-rays.slope, 1e-9)
    target = np.where(distance < 60.0, mark(np.array(0), ROOF), mark(np.array(NOTHING), 0))
    return pack_keys(distance, target)


@given(rays=RAYS, rows=st.lists(ROW, max_size=6), sides=st.lists(WALL, max_size=6))
def test_any_scene(rays: LidarRays, rows: list[tuple[float, ...]], sides: list[tuple[float, ...]]) -> None:
    compare_twins("sensing_lidar_cast_cast_rays", rays, boxes(rows), walls(sides), HEIGHT_M, ground(rays))


@given(rays=RAYS, row=st.tuples(*[st.sampled_from((math.nan, -0.0, 3.0))] * 7))
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
OPTICS = st.builds(
    LidarOptics, st.sampled_from((0.004, 0.0094)), st.sampled_from((0.0, 4e-5, 1e-3)), st.floats(0.0, 0.25),
    st.sampled_from((0, 3, 256)),
)  # fmt: skip
NONE = np.zeros(0)


@given(seed=SEEDS, rays=RAYS, optics=OPTICS, drops=st.booleans(), is_noisy=st.booleans())
def test_points(seed: int, rays: LidarRays, optics: LidarOptics, drops: bool, is_noisy: bool) -> None:
    rng, count = np.random.default_rng(seed), len(rays.order)
    owner, face = rng.choice((0, 1, 2, NOTHING), count), rng.choice((0, 1, 90, 126, ROOF, MIDDLE + 100), count)
    keys = pack_keys(rng.uniform(0.0, 90.0, count), mark(owner, face))
    kept = rng.random(count) < 0.7 if drops else np.zeros(0, np.bool_)
    noise_m = rng.normal(0.0, 30.0, count if is_noisy else 0).astype(np.float32)
    reflects = Reflectivities(*rng.choice((0.0, 0.2, 0.8, 4.0), (4, 3)).astype(np.float32))
    strengths = compute_ground_strengths(rays, ground(rays), optics)
    arguments = rays, keys, strengths, reflects, optics, HEIGHT_M, seed << 21, kept, noise_m
    points, owners = compare_twins("sensing_lidar_returns_build_points", *arguments)
    assert points.shape == (len(owners), 4)


def test_an_owner_without_reflectivity_is_refused() -> None:
    none, optics = NONE.astype(np.float32), LidarOptics(0.004, 0.0, 0.0, 0)
    with pytest.raises(ValueError, match="a reflectivity for each owner"):
        reflects = Reflectivities(none, none, none, none)
        keys, strengths = ground(UPRIGHT), np.zeros(len(UPRIGHT.order))
        build_points(UPRIGHT, keys, strengths, reflects, optics, HEIGHT_M, 0, NONE.astype(bool), none)
