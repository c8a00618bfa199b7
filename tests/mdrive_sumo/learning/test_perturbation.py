"""Perturbations: when they happen, what they do to a plan and to a drive."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from testing.training_data import drive_here, make_settings

from mdrive_sumo.contract import OwnState, Plan
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.learning.perturbation import PERTURBATION, PerturbationBurst, PerturbationSchedule

OWN = OwnState(10.0, 5.0, np.pi / 2, 8.0, 0.0, 0.0, 0.0)
AHEAD = Plan(np.column_stack((np.full(12, 10.0), 5.0 + 2.0 * np.arange(1, 13))), 0.25)
"""North at 8 m/s."""


def list_bursts(seed: int, rate: float, ticks: int) -> list[PerturbationBurst]:
    schedule = PerturbationSchedule(seed, rate)
    found = [schedule.find_burst(tick) for tick in range(ticks)]
    return list(dict.fromkeys(burst for burst in found if burst is not None))


def test_bursts_are_as_long_and_as_rare_as_stated() -> None:
    bursts = list_bursts(1, 1.0, 40_000)[1:-1]
    lengths = np.array([burst.end - burst.start for burst in bursts])
    pauses = np.array([after.start - before.end for before, after in itertools.pairwise(bursts)])
    assert len(bursts) > 200
    assert lengths.min() >= 12 and lengths.max() <= 32
    assert pauses.min() >= 80 and pauses.max() <= 160
    sideways = np.array([burst.offset_m for burst in bursts if burst.offset_m])
    assert 0.5 < len(sideways) / len(bursts) < 0.8
    assert (np.abs(sideways) >= PERTURBATION.offset_m[0]).all() and (np.abs(sideways) <= PERTURBATION.offset_m[1]).all()
    assert 0.3 < (sideways > 0).mean() < 0.7
    assert all(PERTURBATION.pace[0] <= burst.pace <= PERTURBATION.pace[1] for burst in bursts if not burst.offset_m)


def test_the_rate_scales_the_pauses_and_0_means_none() -> None:
    assert list_bursts(1, 0.0, 5_000) == []
    assert 1.6 < len(list_bursts(1, 2.0, 40_000)) / len(list_bursts(1, 1.0, 40_000)) < 2.0
    assert list_bursts(1, 1.0, 2_000) == list_bursts(1, 1.0, 2_000)
    assert list_bursts(1, 1.0, 2_000) != list_bursts(2, 1.0, 2_000)


def test_an_offset_shifts_the_plan_to_the_left_of_the_car_and_grows() -> None:
    burst = PerturbationBurst(100, 120, 0.6, 1.0)
    first, last = burst.apply(AHEAD, OWN, 100), burst.apply(AHEAD, OWN, 119)
    np.testing.assert_allclose(first.points - AHEAD.points, np.tile((-0.05, 0.0), (12, 1)), atol=1e-9)
    np.testing.assert_allclose(last.points - AHEAD.points, np.tile((-0.6, 0.0), (12, 1)), atol=1e-9)


def test_a_pace_moves_the_points_along_the_plan() -> None:
    slow = PerturbationBurst(0, 20, 0.0, 0.5).apply(AHEAD, OWN, 3)
    np.testing.assert_allclose(slow.points, np.column_stack((np.full(12, 10.0), 5.0 + np.arange(1, 13))), atol=1e-9)
    fast = PerturbationBurst(0, 20, 0.0, 1.25).apply(AHEAD, OWN, 3)
    np.testing.assert_allclose(fast.points[[0, -1], 1], (7.5, 29.0), atol=1e-9)  # the last point stays


@pytest.mark.slow
def test_a_perturbed_car_leaves_its_path_is_marked_and_comes_back(short_suite: Path) -> None:
    calm, shaken = (drive_here(make_settings(short_suite, perturbation=rate)) for rate in (0.0, 2.0))
    offsets: dict[bool, list[float]] = {True: [], False: []}
    marked = 0
    for drive in (calm, shaken):
        for cav, decisions in enumerate(drive.decisions):
            path = Polyline(drive.config.scenario.egos[cav].xy)
            episode = drive.episode
            for one in decisions:
                gap = abs(path.project(float(episode.x[one.tick, cav]), float(episode.y[one.tick, cav]))[1])
                offsets[drive is shaken].append(gap)
                marked += int(one.labels["perturbed"])
                assert drive is shaken or not one.labels["perturbed"]
                if drive is shaken and gap > 0.4:  # the answer leads back to the path
                    point = one.labels["expert_plan"][2].astype(np.float64)
                    yaw = float(episode.yaw[one.tick, cav])
                    world = point[0] * np.exp(1j * yaw) + 1j * point[1] * np.exp(1j * yaw)
                    there = float(episode.x[one.tick, cav]) + world.real, float(episode.y[one.tick, cav]) + world.imag
                    assert abs(path.project(*there)[1]) < gap
    assert marked > 10
    assert max(offsets[True]) > max(0.3, 1.2 * max(offsets[False]))
