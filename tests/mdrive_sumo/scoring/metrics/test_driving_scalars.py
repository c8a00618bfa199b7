"""Mean speed and message rate, and the means of scalars over buckets and runs."""

from dataclasses import replace

import pytest
from testing.score_golden import ego, episode, scenario, straight, street

from mdrive_sumo.contract import Message
from mdrive_sumo.core.state import End
from mdrive_sumo.scoring import ScoreMode, make_void_result, score_episode
from mdrive_sumo.scoring.metrics.mean_speed import compute_mean_speed
from mdrive_sumo.scoring.metrics.message_rate import compute_message_rate
from mdrive_sumo.scoring.results import ScenarioResult
from mdrive_sumo.scoring.summary import compute_bucket_means, compute_overall
from mdrive_sumo.v2x.channel import SentMessage

ABOUT = scenario(ego("0"), ego("1", y=3.2))
RECORDED = episode(
    ABOUT,
    {"0": straight(100, speed=10.0), "1": [(0.0, 3.2, 0.0, -4.0)] * 50},
    {"0": End.AGENT_FAILED, "1": End.AGENT_FAILED},
)


def test_mean_speed_is_over_the_time_in_the_world_forward_or_backward() -> None:
    assert compute_mean_speed(RECORDED) == pytest.approx((100 * 10.0 + 50 * 4.0) / 150)


def test_message_rate_counts_a_payload_once() -> None:
    """300 bytes in 5 s, however many receive them."""
    sent = tuple(SentMessage(Message("cam", bytes(size), "0", 1), {}) for size in (100, 200))
    assert compute_message_rate(replace(RECORDED, messages=sent)) == pytest.approx(60.0)
    assert compute_message_rate(RECORDED) == 0.0


def scored(**scalars: float | None) -> ScenarioResult:
    result = score_episode(RECORDED, ABOUT, street(), ScoreMode.MDRIVE, seed=1)
    return result.model_copy(update={"scalars": scalars})


def test_all_scalars_are_in_a_result() -> None:
    result = score_episode(RECORDED, ABOUT, street(), ScoreMode.MDRIVE, seed=1)
    assert set(result.scalars) == {"min_pet", "mean_speed", "comfort", "message_rate", "speeding"}
    assert result.scalars["comfort"] == 100.0


def test_means_are_over_the_scenarios_in_which_a_scalar_is_defined() -> None:
    void = make_void_result(ABOUT, seed=1, reason="SUMO failed")
    rows = [scored(min_pet=2.0, comfort=50.0), scored(min_pet=None, comfort=100.0), void]
    assert compute_overall(rows).scalars == {"min_pet": 2.0, "comfort": 75.0}
    assert compute_bucket_means(rows)["b"].scalars == {"min_pet": 2.0, "comfort": 75.0}
    assert compute_overall([void]).scalars == {}
    assert "scalars" not in compute_overall([void]).model_dump_json()
