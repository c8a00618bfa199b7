"""Scores of one episode, from the recording to the scenario result."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.score_golden import Row, judged
from testing.scored_pair import PAIR, ROADS, pair_episode

from mdrive_sumo.core.state import Contact, Kind
from mdrive_sumo.episode import EpisodeRecord, load_episode, save_episode
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import (
    ScenarioResult,
    ScoreMode,
    score_episode,
)
from mdrive_sumo.scoring.results import BusyRatioSummary
from mdrive_sumo.v2x.radio.radio_medium import BusyRatio


def test_an_episode_makes_a_scenario_result() -> None:
    """Ego 1 starts on the west lane and stays there, which is no infraction; DS (48 + 0.6 * 19) / 2."""
    recorded = pair_episode()
    found = score_episode(recorded, PAIR, ROADS, ScoreMode.MDRIVE, seed=7)
    assert (found.id, found.seed, found.status, found.ticks) == ("s", 7, "ok", 203)
    assert (found.ds, found.sr, found.rc, found.ip) == (29.7, 0.0, 59.5, 0.54)
    assert found.digest == recorded.digest
    first, second = found.egos
    assert (first.ds, first.rc, first.ip, first.outcome, first.reason) == (48.0, 100.0, 0.48, "arrived", "")
    assert [(i.kind, i.tick, i.factor) for i in first.infractions] == [
        ("collision-vehicle", 20, 0.6),
        ("stop-sign", 101, 0.8),
    ]
    assert (second.ds, second.outcome, second.reason) == (11.4, "agent-failed", "crashed: ValueError: no")


def test_the_load_of_a_radio_is_that_at_the_cavs() -> None:
    """A mean of 0.1, 0.2 and 0.6; a road-side unit beside a loud crowd does not count."""
    measured = (BusyRatio(0, "0", 0.1), BusyRatio(4, "0", 0.2), BusyRatio(4, "1", 0.6), BusyRatio(4, "rsu", 0.9))
    heard = score_episode(replace(pair_episode(), busy_ratios=measured), PAIR, ROADS, ScoreMode.MDRIVE, 1)
    assert heard.busy_ratio == BusyRatioSummary(mean=0.3, greatest=0.6)
    silent = score_episode(pair_episode(), PAIR, ROADS, ScoreMode.MDRIVE, 1).model_dump(mode="json")
    assert "busy_ratio" not in silent  # other channels: as before


def test_the_same_episode_in_every_mode() -> None:
    """Mean RC 59.5: asis * 0.6 / 0.8, fixed * 0.48 * 0.6 / 0.8; hard: no clean arrival, half of the limit of 88 s."""
    reference = {"0": 880, "1": 880}
    found = {mode: score_episode(pair_episode(), PAIR, ROADS, mode, 1, reference).ds for mode in ScoreMode}
    assert found == {"mdrive": 29.7, "hard": 14.85, "interdrive_fixed": 21.42, "interdrive_asis": 44.625}


steps = st.tuples(st.floats(-0.1, 0.9), st.floats(-0.3, 0.3), st.floats(-3, 3), st.integers(1, 60))
contacts = st.lists(
    st.tuples(st.integers(0, 250), st.sampled_from("01"), st.sampled_from(["", "a", "b"]), st.sampled_from(Kind)),
    max_size=12,
)


def walk(legs: list[tuple[float, float, float, int]], y: float) -> list[Row]:
    """Legs of constant steps (dx, dy) [m], yaw and number of ticks."""
    x, rows = 0.0, [(0.0, y, 0.0, 0.0)]
    for dx, dy, yaw, ticks in legs:
        for _ in range(ticks):
            x, y = x + dx, y + dy
            rows.append((x, y, yaw, 20 * dx))
    return rows


@st.composite
def episodes(draw: st.DrawFn) -> EpisodeRecord:
    drives = {one: walk(draw(st.lists(steps, min_size=1, max_size=6)), 3.2 * int(one)) for one in "01"}
    hits = sorted(draw(contacts))
    return judged(PAIR, drives, [(tick, Contact(ego_id, other, kind)) for tick, ego_id, other, kind in hits])


def rescored(recorded: EpisodeRecord, about: Scenario, mode: ScoreMode) -> ScenarioResult:
    return score_episode(recorded, about, ROADS, mode, 1, {ego.id: 50 for ego in about.egos})


@pytest.mark.slow
@settings(max_examples=examples(12, 40), deadline=None)
@given(recorded=episodes())
def test_scores_are_in_range_and_consistent(recorded: EpisodeRecord) -> None:
    """Whatever CAVs do, the recomputed criteria agree with the live judge and numbers stay in range."""
    found = rescored(recorded, PAIR, ScoreMode.MDRIVE)
    assert 0.0 <= found.ds <= 100.0
    assert 0.0 <= found.ip <= 1.0
    assert 0.0 <= found.rc <= 100.0
    assert found.ds == pytest.approx(sum(one.ds for one in found.egos) / 2, abs=1e-5)
    for one in found.egos:
        assert one.ds == pytest.approx(one.rc * one.ip, abs=1e-4)


@pytest.mark.slow
@settings(max_examples=examples(5, 15), deadline=None)
@given(recorded=episodes())
def test_a_stored_episode_scores_as_the_live_one(
    recorded: EpisodeRecord, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("episode") / "e.npz"
    save_episode(recorded, path)
    for mode in ScoreMode:
        assert rescored(load_episode(path), PAIR, mode) == rescored(recorded, PAIR, mode)
