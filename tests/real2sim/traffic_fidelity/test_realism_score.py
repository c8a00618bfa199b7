"""The realism score: known likelihoods, and that it falls with what is less like the log."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float
from real2sim.traffic_fidelity.realism_score import (
    COLLISION_WEIGHT,
    COLLISIONS,
    FEATURES,
    INDICATOR_PSEUDOCOUNT,
    MEASURES,
    RealismSamples,
    compute_likelihoods,
    compute_pooled_likelihoods,
    compute_realism,
)

SPEED = FEATURES[0]


def samples(speed: Float, hits: bool = False) -> RealismSamples:
    """Road users with speeds (T, E); everything else is still and alone."""
    still = {feature.name: np.zeros_like(speed) for feature in FEATURES}
    return RealismSamples(still | {"speed": speed}, np.full(speed.shape[1], hits))


def test_a_likelihood_is_the_geometric_mean_of_the_shares_of_the_logged_bins() -> None:
    log = samples(np.array([[1.0], [1.0], [6.0], [np.nan]]))  # bins 0, 0, 2 of 2.5 m/s
    one = samples(np.array([[1.0], [1.0], [1.0], [11.0]]))
    found = compute_likelihoods(log, [one])
    shares = np.array([3.1, 3.1, 0.1]) / (4 + 10 * 0.1)
    assert found["speed"] == pytest.approx(np.exp(np.log(shares).mean()))


def test_speeds_beyond_the_range_are_in_the_last_bin() -> None:
    assert SPEED.find_bins(np.array([-1.0, 0.0, 24.9, 25.0, 99.0])).tolist() == [0, 0, 9, 9, 9]


def test_collisions_are_judged_by_their_share_of_the_rollouts() -> None:
    speed = np.ones((3, 2))
    rollouts = [samples(speed, hits) for hits in (True, False, False, False)]
    share = (1 + INDICATOR_PSEUDOCOUNT) / (4 + 2 * INDICATOR_PSEUDOCOUNT)
    assert compute_likelihoods(samples(speed), rollouts)[COLLISIONS] == pytest.approx(1 - share)
    assert compute_likelihoods(samples(speed, hits=True), rollouts)[COLLISIONS] == pytest.approx(share)


def test_weights_are_those_of_the_challenge_without_road_edges_and_lights() -> None:
    assert sum(feature.weight for feature in FEATURES) + COLLISION_WEIGHT == pytest.approx(1.0 - 0.25 - 0.05)
    assert compute_realism(dict.fromkeys(MEASURES, 0.4)) == pytest.approx(0.4)
    speeds_only = dict.fromkeys(MEASURES, 0.0) | {"speed": 1.0}
    assert compute_realism(speeds_only) == pytest.approx(0.05 / 0.7)
    assert compute_realism({"speed": 0.5}) == pytest.approx(0.5)  # a measure without samples has no weight


@given(st.lists(st.floats(0, 24), min_size=5, max_size=30), st.integers(1, 9))
def test_no_traffic_is_more_likely_than_the_log_is_under_itself(speeds: list[float], shift_bins: int) -> None:
    """The entropy of the log is the bound, but for the pseudo counts, which weigh less with more samples."""
    log = samples(np.array(speeds * 20)[:, None])
    other = samples((np.array(speeds * 20)[:, None] + 2.5 * shift_bins) % 25.0)
    own = compute_likelihoods(log, [log])["speed"]
    assert compute_likelihoods(log, [other])["speed"] <= own * 1.05
    assert compute_pooled_likelihoods(log, [other])["speed"] <= own * 1.05


def test_pooled_histograms_forget_which_vehicle_it_was_and_own_ones_do_not() -> None:
    log = samples(np.array([[1.0, 20.0]] * 30))
    swapped = samples(np.array([[20.0, 1.0]] * 30))
    assert compute_pooled_likelihoods(log, [swapped]) == pytest.approx(compute_pooled_likelihoods(log, [log]))
    assert compute_likelihoods(log, [swapped])["speed"] < 0.01 < compute_likelihoods(log, [log])["speed"]
