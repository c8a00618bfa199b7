"""Red lights (protocol 7.1): the line is at x = 50."""

import pytest
from testing.score_golden import (
    arriving,
    ego,
    episode,
    lane,
    roads,
    scenario,
)
from testing.scored_records import Events, events

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring.metrics import EpisodeMismatch, ScoredEpisode, build_ego_records


def crossing(letters: dict[int, str], signals: str = "program", y: float = 0.0) -> Events:
    on = roads(
        lane("in", (0, 0), (50, 0), successors=("out",), lights={"out": "junction:1"}),
        lane("out", (50, 0), (150, 0)),
        lane("beside", (0, 3.2), (150, 3.2)),
    )
    about = scenario(ego(lanes=("in", "out")), signals=signals)
    states = {tick: {"junction": "r" + letter} for tick, letter in letters.items()}
    recorded = episode(about, {"0": arriving(y=y)}, {"0": End.ARRIVED}, signals=states)
    return events(build_ego_records(ScoredEpisode(recorded, about, on))[0])


@pytest.mark.parametrize(
    ("letter", "red"), [("r", True), ("R", True), ("u", True), ("y", False), ("g", False), ("G", False)]
)
def test_a_red_light_run_over(letter: str, red: bool) -> None:
    """x = 50.5 (tick 101) is the first place beyond the line."""
    assert crossing({0: letter}) == ([("red-light", 101)] if red else [])


def test_the_letter_of_that_very_tick_counts() -> None:
    assert crossing({0: "G", 101: "r"}) == [("red-light", 101)]
    assert crossing({0: "r", 101: "G"}) == []
    assert crossing({0: "G", 102: "r"}) == []


def test_frozen_green_has_no_red_lights() -> None:
    assert crossing({0: "r"}, signals="frozen-green") == []


def test_the_next_lane_is_no_way_around_a_red_light() -> None:
    assert crossing({0: "r"}, y=3.2) == [("red-light", 101)]


@pytest.mark.slow
def test_a_light_without_a_recorded_state_is_an_error() -> None:
    with pytest.raises(EpisodeMismatch, match="junction"):
        crossing({})
