"""Intervals of a study's rows, its lines against base and references, and its curves."""

from dataclasses import replace
from pathlib import Path

import pytest
from testing.study_samples import IDEAL, OFF, make_row, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.paired_intervals import (
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
)
from mdrive_sumo.study.conditions import (
    FACTORS,
    ChannelCondition,
    make_conditions,
    parse_levels,
)
from mdrive_sumo.study.plots import draw_curves, make_curves
from mdrive_sumo.study.study_runs import is_silent
from mdrive_sumo.study.study_summary import StudyLine, summarise_rows


def test_differences_are_paired_and_void_scenarios_are_left_out() -> None:
    base = group_by_scenario(
        [make_scenario("a", 50), make_scenario("b", 10), make_scenario("c", 0, status="void"), make_scenario("d", 5)]
    )
    worse = group_by_scenario(
        [make_scenario("a", 40), make_scenario("b", 0), make_scenario("c", 99), make_scenario("d", 0, status="void")]
    )
    assert set(worse) == {"a", "b", "c"}
    found = compute_difference_interval(worse, base, "ds")
    assert found is not None
    assert (found.mean, found.units) == (-10.0, 2)
    assert compute_score_interval(group_by_scenario([make_scenario("a", 0, status="void")]), "ds") is None


def test_a_scenario_that_is_void_with_one_seed_is_left_out_with_all() -> None:
    assert set(
        group_by_scenario([make_scenario("a", 1, 0), make_scenario("a", 1, 1, status="void"), make_scenario("b", 1, 0)])
    ) == {"b"}


def test_times_are_means_over_the_scenarios_in_which_all_seeds_have_one() -> None:
    """Scenario a has 1.0 and 2.0, b has none with seed 1; efficient SR (50 + 100 + 0 + 0) / 4."""

    def timed(name: str, seed: int, time_ratio: float | None, efficient_sr: float) -> ScenarioResult:
        return make_scenario(name, 100, seed).model_copy(
            update={"time_ratio": time_ratio, "efficient_sr": efficient_sr}
        )

    (base,) = make_conditions(IDEAL, {}, "one-at-a-time")
    one = make_row("talker", base, timed("a", 0, 1.0, 50.0), timed("b", 0, 1.0, 0.0))
    two = make_row("talker", base, timed("a", 1, 2.0, 100.0), timed("b", 1, None, 0.0))
    (line,) = summarise_rows((replace(one, results=(*one.results, *two.results)),))
    assert line.time_ratio is not None and line.efficient_sr is not None
    assert (line.time_ratio.mean, line.timed, line.efficient_sr.mean) == (1.5, 1, 37.5)


def compare_conditions() -> tuple[tuple[StudyLine, ...], ChannelCondition]:
    base, slow = make_conditions(IDEAL, {"latency": parse_levels("latency", "6")}, "one-at-a-time")
    off = ChannelCondition("off", OFF, {})
    rows = (
        make_row("talker", base, make_scenario("a", 70), make_scenario("b", 50)),
        make_row("talker", off, make_scenario("a", 30), make_scenario("b", 30)),
        make_row("talker", slow, make_scenario("a", 60), make_scenario("b", 40)),
        make_row("omniscient", base, make_scenario("a", 90), make_scenario("b", 70)),
    )
    return summarise_rows(rows), base


def test_a_line_compares_with_the_base_and_the_references() -> None:
    found, _ = compare_conditions()
    base, off, slow, best = found
    assert base.ds_difference is None and base.captured and base.captured.scenario_mean == pytest.approx(0.6)
    assert off.captured and off.captured.scenario_mean == 0.0
    assert slow.ds and slow.ds.mean == 50.0
    assert slow.ds_difference and (slow.ds_difference.mean, slow.ds_difference.units) == (-10.0, 2)
    assert slow.captured and slow.captured.scenario_mean == pytest.approx(0.4)
    assert best.captured is None


@pytest.mark.slow
def test_curves_go_through_the_base_and_are_drawn_alike_every_time(tmp_path: Path) -> None:
    found, base = compare_conditions()
    (curve,) = make_curves(found, FACTORS["latency"], base)
    assert list(curve.lines) == [(0,), (6,)]
    assert curve.off is found[1]
    assert make_curves(found, FACTORS["loss"], base) == ()
    first = [path.read_bytes() for path in draw_curves([curve], FACTORS["latency"], "title", tmp_path / "latency")]
    again = [path.read_bytes() for path in draw_curves([curve], FACTORS["latency"], "title", tmp_path / "again")]
    assert first[0].startswith(b"\x89PNG") and b"latency [ticks of 0.05 s]" not in first[0]
    assert first == again
    with pytest.raises(InputError, match="cannot be written"):
        draw_curves([curve], FACTORS["latency"], "title", tmp_path / "missing" / "latency")


def test_silence_is_only_believed_of_scenarios_that_are_not_void() -> None:
    base = ChannelCondition("base", IDEAL, {})
    assert is_silent(make_row("idm", base, make_scenario("a", 1)))
    assert not is_silent(make_row("idm", base, make_scenario("a", 1), make_scenario("b", 0, status="void")))
    assert not is_silent(make_row("idm", base, make_scenario("a", 1, comm={"sent": 1})))
