"""Error profiles of detectors: what is seen falls with distance and occlusion, errors grow."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract.detector_profiles import FAR_M, IDEAL, PROFILES, PUBLISHED

SURROGATES = sorted(set(PROFILES) - {IDEAL})
distances = st.floats(0.0, 10 * FAR_M)
shares = st.floats(0.0, 1.0)


def at(*values: float) -> Any:
    return np.array(values)


def test_each_surrogate_has_a_published_figure_and_no_other() -> None:
    assert sorted(PUBLISHED) == SURROGATES
    for name, precision in PUBLISHED.items():
        assert 0.0 < precision.ap70 < precision.ap50 < 1.0 and precision.source, name


def test_the_ideal_detector_sees_all_that_is_in_sight_exactly() -> None:
    ideal = PROFILES[IDEAL]
    assert ideal.recall_at(at(0.0, 50.0, 500.0), at(1.0, 0.1, 0.5)).tolist() == [1.0, 1.0, 1.0]
    assert ideal.recall_at(at(1.0), at(0.09)).tolist() == [0.0]
    assert ideal.spread_at(at(0.0, 500.0)).tolist() == [0.0, 0.0]
    assert (ideal.yaw_sigma, ideal.size_sigma, ideal.speed_sigma, ideal.false_positives, ideal.latency_ticks) == (
        0,
    ) * 5


@pytest.mark.parametrize("name", SURROGATES)
def test_recall_at_the_places_that_its_fields_name(name: str) -> None:
    profile = PROFILES[name]
    full, hidden = profile.plain_visible, profile.min_visible
    near, far = profile.recall_at(at(0.0, FAR_M), at(1.0, full))
    assert near == profile.recall and far == pytest.approx(profile.recall * profile.recall_far)
    half, none = profile.recall_at(at(0.0, 0.0), at(full / 2, hidden * 0.999))
    assert half == pytest.approx(profile.recall / 2) and none == 0.0
    assert profile.spread_at(at(0.0, profile.spread_doubles_m)).tolist() == [profile.spread, 2 * profile.spread]


@given(st.sampled_from(sorted(PROFILES)), distances, distances, shares, shares)
def test_farther_and_more_hidden_is_seen_no_better(
    name: str, one_m: float, other_m: float, one_share: float, other_share: float
) -> None:
    profile = PROFILES[name]
    (near_m, far_m), (hidden, visible) = sorted((one_m, other_m)), sorted((one_share, other_share))
    better, farther, darker = profile.recall_at(at(near_m, far_m, near_m), at(visible, visible, hidden))
    assert min(farther, darker) >= 0.0 and max(farther, darker) <= better <= 1.0
    near_spread, far_spread = profile.spread_at(at(near_m, far_m))
    assert 0.0 <= near_spread <= far_spread
