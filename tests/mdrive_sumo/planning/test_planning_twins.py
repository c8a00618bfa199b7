"""Compiled functions of planning against their Python text, on random inputs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.planning.profile_search import find_fastest_profile  # noqa: F401
from mdrive_sumo.planning.speed_lattice import build_transitions, choose_lattice
from mdrive_sumo.planning.speed_profile import SpeedProfileProblem

SEEDS = st.integers(0, 2**32 - 1)


def random_problem(rng: np.random.Generator) -> SpeedProfileProblem:
    lattice = choose_lattice(float(rng.choice((8.0, 13.9, 22.0, 33.3))))
    cells, layers = int(rng.integers(1, 90)), int(rng.integers(0, 16))
    blocked = np.zeros((layers * lattice.samples, cells), dtype=np.bool_)
    for _ in range(int(rng.integers(0, 5))):
        if blocked.size:
            row, cell = int(rng.integers(len(blocked))), int(rng.integers(cells))
            blocked[row : row + int(rng.integers(1, 30)), cell : cell + int(rng.integers(1, 9))] = True
    goal = int(rng.integers(cells + 3))
    return SpeedProfileProblem(
        start_s=float(rng.uniform(0.0, 50.0)),
        speed=float(rng.choice((0.0, rng.uniform(0.0, 40.0)))),
        cells=np.arange(cells),
        limits=rng.integers(0, lattice.top + 3, cells),
        goals=slice(goal, None) if rng.random() < 0.5 else slice(goal, goal + int(rng.integers(1, 6))),
        blocked=blocked,
        must_move=rng.random(layers) < rng.choice((0.0, 0.3)),
        ends_standing=bool(rng.random() < 0.3),
        wait_penalty=float(rng.choice((0.0, 0.05))),
        lattice=lattice,
        blocked_after=rng.random(cells if rng.random() < 0.5 else 0) < 0.1,
    )


@given(seed=SEEDS)
def test_searches_of_speed_profiles(seed: int) -> None:
    problem = random_problem(np.random.default_rng(seed))
    compare_twins("planning_profile_search_search_profile", problem, build_transitions(problem.lattice))


@pytest.mark.parametrize("speed", [float("nan"), float("inf")])
def test_a_speed_that_is_no_number_is_refused(speed: float) -> None:
    problem = SpeedProfileProblem(0.0, speed, np.zeros(1, np.int64), np.ones(1, np.int64), slice(0, None),
                                  np.zeros((0, 1), np.bool_), np.zeros(0, np.bool_))  # fmt: skip
    compare_twins("planning_profile_search_search_profile", problem, build_transitions(problem.lattice))
