"""The compiled solver has the bits of the Python text."""

import numpy as np
import pytest
from testing.twins import compare_twins

from real2sim.tracks import bounded_trajectory

NAME = "real2sim_tracks_bounded_trajectory__solve"


@pytest.mark.parametrize("frames", [8, 9, 13, 16])
@pytest.mark.parametrize("noise_m", [0.0, 0.05, 4.0])
def test_trajectories(frames: int, noise_m: float) -> None:
    rng = np.random.default_rng(frames)
    wanted = np.stack((np.arange(frames) * 0.8, np.zeros(frames))) + noise_m * rng.normal(size=(2, frames))
    matrices = bounded_trajectory._build_matrices(frames, 4.6, 5.7, 0.1)
    heading = rng.normal(0.0, 0.3, frames - 1) if frames % 2 else np.zeros(frames - 1)
    ahead = np.stack((np.cos(heading), np.sin(heading))) * (frames != 9)
    compare_twins(NAME, wanted, *matrices, ahead, rng.random(frames - 1) < 0.2)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_numbers_that_no_trajectory_has(bad: float) -> None:
    wanted = np.zeros((2, 8))
    wanted[0, 3] = bad
    matrices = bounded_trajectory._build_matrices(8, 4.6, 5.7, 0.1)
    compare_twins(NAME, wanted, *matrices, np.ones((2, 7)), np.zeros(7, dtype=np.bool_))


def test_products_are_summed_as_einsum_does_on_the_machine_of_most_users() -> None:
    """So a converted log is the same file as before the layer; other processors fuse or widen the sums of einsum."""
    rng = np.random.default_rng(0)
    for columns in (5, 8, 17, 101):
        matrix, vectors = rng.normal(size=(7, columns)), rng.normal(size=(2, columns))
        expected = np.einsum("ij,kj->ki", matrix, vectors)
        np.testing.assert_allclose(bounded_trajectory._multiply(matrix, vectors), expected, rtol=1e-13)
