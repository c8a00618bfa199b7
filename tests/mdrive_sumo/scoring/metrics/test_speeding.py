"""Speeding: the limit of every tick, share and greatest excess, and the infraction of mode hard, worked out by hand."""

import json
from collections.abc import Sequence
from dataclasses import replace

import pytest
from testing.score_golden import Row, arriving, ego, episode, lane, roads, scenario, straight, street

from mdrive_sumo.core.state import End
from mdrive_sumo.roads import Lane
from mdrive_sumo.scoring import EgoResult, ScenarioResult, ScoreMode, score_episode
from mdrive_sumo.scoring.metrics import build_ego_track
from mdrive_sumo.scoring.metrics.speeding import FORGIVEN_TICKS, PENALTY_FACTOR
from mdrive_sumo.scoring.results_check import find_scenario_faults

LIMIT = 13.9
FAST = 16.0


def with_limit(name: str, *points: tuple[float, float], limit: float, **more: object) -> Lane:
    return replace(lane(name, *points, **more), speed_limit=limit)


def score(rows: Sequence[Row], mode: ScoreMode = ScoreMode.HARD, end: End = End.ARRIVED) -> ScenarioResult:
    about = scenario(ego("0"))
    return score_episode(episode(about, {"0": rows}, {"0": end}), about, street(), mode, 0, {"0": 100})


def sped(ticks: int) -> list[Row]:
    """203 ticks to the goal, of which the first are driven at 16 m/s, 2.1 m/s above the limit."""
    rows = arriving()
    return [(x, y, yaw, FAST if tick < ticks else speed) for tick, (x, y, yaw, speed) in enumerate(rows)]


def test_share_and_greatest_excess_of_a_cav() -> None:
    result = score(sped(100), ScoreMode.MDRIVE)
    (cav,) = result.egos
    assert cav.speeding is not None
    assert (cav.speeding.share, cav.speeding.greatest) == (pytest.approx(100 * 100 / 203, abs=1e-6), pytest.approx(2.1))
    assert result.scalars["speeding"] == cav.speeding.share


@pytest.mark.parametrize(("speed", "share"), [(LIMIT, 0.0), (15.29, 0.0), (15.291, 100.0), (-15.291, 100.0)])
def test_speeding_begins_above_ten_per_cent(speed: float, share: float) -> None:
    (cav,) = score(straight(20, speed=speed), ScoreMode.MDRIVE, End.AGENT_FAILED).egos
    assert cav.speeding is not None
    assert cav.speeding.share == share
    assert cav.speeding.greatest == pytest.approx(abs(speed) - LIMIT)


@pytest.mark.parametrize(("ticks", "costs"), [(FORGIVEN_TICKS, False), (FORGIVEN_TICKS + 1, True)])
def test_in_mode_hard_more_than_a_second_costs(ticks: int, costs: bool) -> None:
    (cav,) = score(sped(ticks)).egos
    expected = [("speeding", FORGIVEN_TICKS, PENALTY_FACTOR)] if costs else []
    assert [(one.kind, one.tick, one.factor) for one in cav.infractions] == expected
    assert cav.ip == (PENALTY_FACTOR if costs else 1.0)


@pytest.mark.parametrize("mode", [mode for mode in ScoreMode if mode is not ScoreMode.HARD])
def test_no_other_mode_has_the_infraction(mode: ScoreMode) -> None:
    result = score(sped(203), mode)
    assert (result.ds, result.egos[0].infractions) == (100.0, ())


def test_haste_gains_nothing_in_mode_hard() -> None:
    """A clean drive in twice the reference has DS 49.5; the whole way at 16 m/s counts with the whole time limit."""
    assert score(arriving()).ds == pytest.approx(100 * 100 / 202, abs=1e-4)
    assert score(sped(203)).ds < score(arriving()).ds


def test_a_junction_has_the_limit_of_the_fastest_road_that_it_joins() -> None:
    """Two lanes lead through the junction, both with the low speed of their curve."""
    on = roads(
        with_limit("in", (-50, 0), (30, 0), limit=20.0, successors=("a",)),
        with_limit("a", (30, 0), (40, 0), limit=4.0, successors=("b",), junction=True),
        with_limit("b", (40, 0), (50, 0), limit=5.0, successors=("out",), junction=True),
        with_limit("out", (50, 0), (150, 0), limit=8.0),
    )
    assert dict(zip(on.lanes, on.legal_speed.tolist(), strict=True)) == {"in": 20.0, "a": 20.0, "b": 20.0, "out": 8.0}
    about = scenario(ego("0"))
    recorded = episode(about, {"0": arriving()}, {"0": End.ARRIVED})
    limits = build_ego_track(recorded, about, on, 0).speed_limits
    assert sorted(set(limits.tolist())) == [8.0, 20.0]
    assert (limits[103], limits[104]) == (20.0, 8.0)  # the junction ends at 50 m and covers half a width, 1.6 m, more


@pytest.mark.parametrize(("y", "expected"), [(1.5, 15.0), (1.7, 5.0), (9.0, 5.0)])
def test_the_greatest_limit_of_overlapping_lanes_counts(y: float, expected: float) -> None:
    """The CAV drives on the slow lane; the fast one covers 1.6 m to both sides of y = 0."""
    on = roads(with_limit("fast", (-50, 0), (150, 0), limit=15.0), with_limit("slow", (-50, y), (150, y), limit=5.0))
    about = scenario(ego("0"))
    recorded = episode(about, {"0": straight(3, y=y)}, {"0": End.ARRIVED})
    assert build_ego_track(recorded, about, on, 0).speed_limits.tolist() == [expected] * 3


def test_results_from_before_are_read_and_values_out_of_range_are_faults() -> None:
    result = score(sped(50))
    assert list(find_scenario_faults(result, ScoreMode.HARD, (0,))) == []
    stored = json.loads(result.egos[0].model_dump_json())
    del stored["speeding"]
    old = EgoResult.model_validate(stored)
    assert old.speeding is None
    assert "speeding" not in json.loads(old.model_dump_json())
    stored["speeding"] = {"share": 101.0, "greatest": -1.0}
    forged = result.model_copy(update={"egos": (EgoResult.model_validate(stored),)})
    faults = list(find_scenario_faults(forged, ScoreMode.HARD, (0,)))
    assert any("speeding.share: expected 0 to 100, found 101" in fault for fault in faults)
    assert any("speeding.greatest: expected at least 0" in fault for fault in faults)
