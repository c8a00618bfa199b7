"""Endings and route completion (protocol 5.2 and 6)."""

from collections.abc import Sequence

import pytest
from testing.score_golden import (
    Row,
    arriving,
    ego,
    episode,
    scenario,
    straight,
    street,
)
from testing.scored_records import record

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End
from mdrive_sumo.scoring import ScenarioResult, ScoreMode, score_episode
from mdrive_sumo.scoring.metrics import EpisodeMismatch, ScoredEpisode, build_ego_records
from mdrive_sumo.scoring.metrics.endings import LATE_FACTOR, LATE_KINDS
from mdrive_sumo.scoring.results_check import find_scenario_faults


def test_a_clean_drive_has_no_infractions() -> None:
    found = record(arriving(), End.ARRIVED)
    assert (found.rc, found.ip, found.infractions) == (100.0, 1.0, ())


def test_completion_of_a_cav_that_did_not_arrive() -> None:
    """41 ticks: x = 20 at last, and point 19 is the last one passed."""
    assert record(straight(41)).rc == 19.0


def test_the_end_is_marked_without_a_cost() -> None:
    found = record(straight(602, speed=0.0), End.BLOCKED)
    assert [(i.kind, i.tick, i.factor) for i in found.infractions] == [("blocked", 601, 1.0)]
    assert (found.rc, found.ip, found.ending.end) == (0.0, 1.0, End.BLOCKED)


def test_a_time_out_keeps_the_way_made() -> None:
    """T = 0.8 * 100 + 8 = 88 s; at 1 m/s the CAV is at x = 88 then, and point 87 is the last one passed."""
    found = record(straight(1761, speed=1.0), End.TIMED_OUT)
    assert [(i.kind, i.tick) for i in found.infractions] == [("timed-out", 1760)]
    assert (found.rc, found.ip) == (87.0, 1.0)


def test_a_deviation_ends() -> None:
    rows = [(0.0, 0.0, 0.0, 9.0), (0.0, -30.0, 0.0, 9.0)]
    found = record(rows, End.DEVIATED)
    assert [(i.kind, i.tick) for i in found.infractions] == [("route-deviation", 1)]


def test_an_agents_failure_is_taken_from_the_recording() -> None:
    found = record(straight(5))
    assert [(i.kind, i.tick, i.factor) for i in found.infractions] == [("agent-failed", 4, 0.6)]
    assert found.ending.text == "ValueError: no"


LATE: list[tuple[list[Row], End, str]] = [
    (straight(1761, speed=1.0), End.TIMED_OUT, "timed-out"),
    (straight(602, speed=0.0), End.BLOCKED, "blocked"),
    ([(0.0, 0.0, 0.0, 9.0), (0.0, -30.0, 0.0, 9.0)], End.DEVIATED, "route-deviation"),
]


@pytest.mark.parametrize(("rows", "end", "kind"), LATE)
@pytest.mark.parametrize("mode", ScoreMode)
def test_in_mode_hard_alone_a_cav_that_does_not_arrive_pays(
    rows: list[Row], end: End, kind: str, mode: ScoreMode
) -> None:
    result = score(rows, end, mode)
    (cav,) = result.egos
    factor = LATE_FACTOR if mode is ScoreMode.HARD else 1.0
    assert [(one.kind, one.factor) for one in cav.infractions] == [(kind, factor)]
    assert (kind in LATE_KINDS, cav.ip) == (True, factor)
    assert list(find_scenario_faults(result, mode, (0,))) == []


def test_who_arrives_with_the_end_of_the_time_limit_is_late_in_mode_hard() -> None:
    """The limit of 10.05 s is tick 201, in which the route is completed: 0.7 x 100 %, x 100 / 201 for the time."""
    late = score(arriving()[:-1], End.TIMED_OUT, ScoreMode.HARD, time_limit_s=10.05)
    assert (late.rc, late.ip, late.sr) == (100.0, LATE_FACTOR, 0.0)
    assert late.ds == pytest.approx(70 * 100 / 201, abs=1e-4)
    in_time = score(arriving(), End.ARRIVED, ScoreMode.HARD, time_limit_s=10.15)
    assert (in_time.ip, in_time.sr) == (1.0, 100.0)


@pytest.mark.parametrize("mode", ScoreMode)
def test_an_agents_failure_costs_the_same_in_every_mode_and_more_than_lateness(mode: ScoreMode) -> None:
    (cav,) = score(straight(5), End.AGENT_FAILED, mode).egos
    assert [(one.kind, one.factor) for one in cav.infractions] == [("agent-failed", 0.6)]
    assert cav.ip < LATE_FACTOR


def score(rows: Sequence[Row], end: End, mode: ScoreMode, time_limit_s: float | None = None) -> ScenarioResult:
    about = scenario(ego("0").model_copy(update={"time_limit_s": time_limit_s}))
    return score_episode(episode(about, {"0": rows}, {"0": end}), about, street(), mode, 0, {"0": 100})


@pytest.mark.parametrize(
    ("rows", "end"),
    [
        (straight(5), End.ARRIVED),
        (straight(602, speed=0.0), End.TIMED_OUT),
        (straight(601, speed=0.0), End.BLOCKED),
        (straight(603, speed=0.0), End.BLOCKED),
        (arriving(), End.AGENT_FAILED),
        (arriving()[:-1], End.ARRIVED),
    ],
)
def test_a_recording_that_contradicts_its_frames_is_refused(rows: list[Row], end: End) -> None:
    with pytest.raises(EpisodeMismatch, match="CAV 0"):
        record(rows, end)


def test_an_episode_of_another_scenario_is_refused() -> None:
    recorded = episode(scenario(), {"0": arriving()}, {"0": End.ARRIVED})
    with pytest.raises(InputError, match="expected scenario other"):
        build_ego_records(ScoredEpisode(recorded, scenario(id="other"), street()))
