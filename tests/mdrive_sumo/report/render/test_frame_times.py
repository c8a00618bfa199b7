"""Which ticks are shown, and for how long."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.viewer_crossing import record

from mdrive_sumo.core.state import End
from mdrive_sumo.report.render.frame_times import (
    choose_durations_cs,
    choose_telling_cav,
    choose_ticks,
    find_telling_tick,
)
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult


def result(*ticks: int, factor: float = 0.6) -> ScenarioResult:
    """A result whose CAVs have an infraction in these ticks; -1: none."""
    egos = [
        EgoResult(
            id=f"cav_{i}", outcome=End.ARRIVED, reason="", ds=60.0, rc=100.0, ip=0.6,
            infractions=() if tick < 0 else (Infraction(kind="k", tick=tick, x=0, y=0, factor=factor, other=""),),
        )
        for i, tick in enumerate(ticks)
    ]  # fmt: skip
    return ScenarioResult(
        id="crossing-4", bucket="B", category="c", seed=0, status="ok", reason="", min_ttc=None, digest="",
        ticks=40, egos=tuple(egos), ds=60.0, sr=0.0, rc=100.0, ip=0.6,
    )  # fmt: skip


@given(st.integers(0, 300), st.integers(0, 900), st.integers(1, 50), st.floats(0.05, 20))
def test_a_video_is_as_long_as_what_it_shows(first: int, length: int, fps: int, speed: float) -> None:
    ticks = choose_ticks(first, first + length, fps, speed)
    assert ticks[0] == first and ticks[-1] <= first + length
    assert ticks == sorted(ticks)
    seconds = length / 20 / speed
    assert len(ticks) / fps == pytest.approx(seconds, abs=1.1 / fps + 0.05 / speed)


@pytest.mark.parametrize(("fps", "count"), [(10, 100), (20, 200), (5, 50)])
def test_ten_seconds_have_ten_seconds_of_frames(fps: int, count: int) -> None:
    assert len(choose_ticks(0, 199, fps, 1.0)) == count


@pytest.mark.slow
@given(st.integers(1, 2000), st.integers(1, 50))
def test_rounded_durations_do_not_add_up(frames: int, fps: int) -> None:
    durations = choose_durations_cs(frames, fps, 1.0)
    assert len(durations) == frames and min(durations) >= 2
    assert sum(durations) / 100 == pytest.approx(frames / fps + 1.0, abs=0.006)


def test_the_telling_tick_is_the_first_costly_infraction_of_any_episode() -> None:
    episode = record(ticks=40)
    assert find_telling_tick([(episode, result(-1, 30)), (episode, result(25, 12))]) == 12
    assert choose_telling_cav(episode, result(25, 12)) == "cav_1"


def test_without_one_it_is_the_first_contact_else_the_middle() -> None:
    touching, alone = record(ticks=40), replace(record(ticks=50), contacts=())
    assert find_telling_tick([(touching, result(30, factor=1.0))]) == min(tick for tick, _ in touching.contacts)
    assert choose_telling_cav(touching, result(30, factor=1.0)) == "cav_0"
    assert find_telling_tick([(alone, result(-1))]) == 25
