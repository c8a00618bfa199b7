"""Rewards add up to the driving score of the protocol: red lights, stop signs, lanes and collisions included."""

import math
from collections.abc import Iterable, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.score_golden import Row, ego, episode, hit, lane, roads, scenario

from mdrive_sumo.core.state import Actors, EgoState, End, Frame
from mdrive_sumo.episode import quantize_frame
from mdrive_sumo.rl.driving_reward import DrivingReward
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scoring.metrics import ScoredEpisode, build_ego_records
from mdrive_sumo.scoring.metrics.endings import AGENT_FAILED_FACTOR
from mdrive_sumo.scoring.score_mode import compute_driving_score

SIGN = StopSignBox(id="stop", lane="in", line_pos_m=30.0, length_m=6.0)
ROADS = roads(
    lane("in", (0, 0), (50, 0), successors=("out",), lights={"out": "junction:1"}),
    lane("out", (50, 0), (150, 0)),
    lane("oncoming", (150, 3.2), (0, 3.2)),
    signs=[SIGN],
)
ABOUT = scenario(ego(lanes=("in", "out")), signals="program")
"""A route of 100 m with a stop sign at 30 m and a light at 50 m."""


def _sum_rewards(rows: Sequence[Row], decisions: Iterable[int], red_from: int, hits: Sequence[int] = ()) -> float:
    """Return the sum of the rewards, taken in the ticks of decisions and in the last one."""
    reward = DrivingReward(ABOUT.egos[0], ABOUT, ROADS)
    taken: list[float] = []
    for tick, row in enumerate(rows):
        contacts = (hit("0", "b"),) if tick in hits else ()
        signals = {"junction": "rr" if tick >= red_from else "rG"}
        reward.add(quantize_frame(Frame(tick, {"0": EgoState(*row)}, Actors.empty(), signals, contacts)))
        if tick in decisions or tick == len(rows) - 1:
            taken.append(reward.take_reward())
    return math.fsum(taken)


def _score(rows: Sequence[Row], red_from: int, hits: Sequence[int] = ()) -> float:
    """Return DS/100 of the recorded drive, without the penalty of the agent, which fails in the last tick."""
    signals = {0: {"junction": "rG"}} | {red_from: {"junction": "rr"}}
    contacts = {tick: [hit("0", "b")] for tick in hits}
    recorded = episode(ABOUT, {"0": rows}, {"0": End.AGENT_FAILED}, contacts, signals=signals)
    record = build_ego_records(ScoredEpisode(recorded, ABOUT, ROADS))[0]
    return compute_driving_score(record) / 100.0 / AGENT_FAILED_FACTOR


def _steady(ticks: int = 150, y: float = 0.0) -> list[Row]:
    return [(0.6 * tick, y, 0.0, 12.0) for tick in range(ticks)]


@pytest.mark.parametrize(
    ("rows", "red_from", "hits", "potential"),
    [
        (_steady(40), 999, (), 0.23),  # 23.4 m of 100 m
        (_steady(80), 999, (), 0.47 * 0.8),  # past the stop sign
        (_steady(90), 0, (), 0.53 * 0.8 * 0.7),  # and the red light
        (_steady(90), 86, (), 0.53 * 0.8),  # red after it was crossed
        (_steady(40), 999, (20, 21), 0.23 * 0.6),  # one collision
    ],
)
def test_rewards_worked_by_hand(rows: list[Row], red_from: int, hits: tuple[int, ...], potential: float) -> None:
    assert _sum_rewards(rows, range(0, 999, 4), red_from, hits) == pytest.approx(potential, abs=1e-12)


def test_a_reward_falls_in_the_decision_of_its_infraction() -> None:
    """The car crosses the red line between ticks 83 (49.8 m) and 84 (50.4 m)."""
    before, after = (_sum_rewards(_steady(ticks), range(0, 999, 4), 0) for ticks in (84, 85))
    assert (before, after) == pytest.approx((0.49 * 0.8, 0.50 * 0.8 * 0.7), abs=1e-12)


@given(
    steps=st.lists(st.sampled_from((0.0, 0.02, 0.3, 0.6, 0.6, 0.65)), min_size=30, max_size=150),
    sides=st.lists(st.sampled_from((0.0, 0.0, 1.9, 3.2, 6.4)), min_size=4, max_size=4),
    yaw=st.sampled_from((0.0, 0.5, 3.0)),
    red_from=st.integers(1, 150),
    decisions=st.sets(st.integers(0, 150)),
    hits=st.sets(st.integers(0, 150), max_size=3),
)
def test_rewards_of_any_decisions_add_up_to_the_score(
    steps: list[float], sides: list[float], yaw: float, red_from: int, decisions: set[int], hits: set[int]
) -> None:
    rows: list[Row] = []
    x = 0.0
    for tick, step in enumerate(steps):
        x += step
        rows.append((x, sides[4 * tick // len(steps)], yaw, 20.0 * step))
    expected = _score(rows, red_from, sorted(hits))
    assert _sum_rewards(rows, decisions, red_from, sorted(hits)) == pytest.approx(expected, abs=1e-12)
