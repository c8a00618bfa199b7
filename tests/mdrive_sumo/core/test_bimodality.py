"""Times in two groups are found; those of agents that are only slow, or noisy, are not."""

import math
import random

import pytest

from mdrive_sumo.core.bimodality import BIMODAL_D, describe_modes, is_bimodal


def noisy(random_: random.Random, count: int, median_s: float, sigma: float = 0.3) -> list[float]:
    """Times of an agent on a busy machine: log-normal."""
    return [median_s * math.exp(random_.gauss(0.0, sigma)) for _ in range(count)]


@pytest.mark.parametrize("seed", range(5))
def test_a_sender_with_two_or_four_levels_is_found(seed: int) -> None:
    random_ = random.Random(seed)
    for levels in ((0.0, 0.05), (0.0, 0.05, 0.1, 0.15), (0.0, 0.0, 0.0, 0.02)):
        times = [value + random_.choice(levels) for value in noisy(random_, 400, 0.001)]
        modes = describe_modes(times)
        assert is_bimodal(modes), (levels, modes)
        assert modes is not None and modes["high_ms"] > 10 * modes["low_ms"]


@pytest.mark.parametrize("seed", range(5))
def test_honest_times_are_not(seed: int) -> None:
    random_ = random.Random(seed)
    uniform = [random_.uniform(0.01, 0.1) for _ in range(400)]
    growing = [0.002 + 0.00002 * tick for tick in range(400)]
    outliers = [*noisy(random_, 390, 0.002), *(0.3 for _ in range(10))]  # imports and garbage collection
    heavy = [0.002 / random_.random() ** 0.5 for _ in range(400)]
    for times in (noisy(random_, 400, 0.001), noisy(random_, 400, 0.05, 0.8), uniform, growing, outliers, heavy):
        assert not is_bimodal(describe_modes(times)), describe_modes(times)


def test_the_uniform_distribution_sets_the_threshold() -> None:
    modes = describe_modes([math.exp(step / 1000) for step in range(1000)])
    assert modes is not None and modes["d"] == pytest.approx(2 * math.sqrt(3), abs=0.01) and modes["d"] < BIMODAL_D
    assert modes["high_share"] == 0.5


def test_little_says_nothing() -> None:
    assert describe_modes([]) is None and describe_modes([0.001, 0.1] * 10) is None
    assert not is_bimodal(None)
    close = describe_modes([0.0010, 0.0019] * 50)
    assert close is not None and close["d"] > BIMODAL_D and not is_bimodal(close), "less than 2 ms apart"
    assert describe_modes([0.001] * 50) is not None and not is_bimodal(describe_modes([0.001] * 50))
