"""Time ratio and efficient SR, from hand-made cases and against an oracle that follows docs/scoring.md."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.score_golden import scenario
from testing.scored_pair import PAIR, ROADS, RUN, pair_episode

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End
from mdrive_sumo.scenario.suite import ScoreModeName, Suite, SuiteFile
from mdrive_sumo.scoring import (
    EgoResult,
    ScenarioResult,
    ScoreMode,
    apply_reference_times,
    find_arrival_ticks,
    make_void_result,
    score_episode,
    summarize_run,
)
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from mdrive_sumo.scoring.results_check import find_scenario_faults


def cav(name: str, ticks: int | None, ds: float = 100.0, outcome: End = End.ARRIVED) -> EgoResult:
    return EgoResult(id=name, outcome=outcome, reason="", ds=ds, rc=100.0, ip=1.0, ticks=ticks, infractions=())


def driven(*cavs: EgoResult, sr: float = 100.0, name: str = "a", bucket: str = "One") -> ScenarioResult:
    """A result with these CAVs; only what the times depend on is meaningful."""
    about = scenario(id=name, bucket=bucket)
    return make_void_result(about, 1, "").model_copy(update={"status": "ok", "sr": sr, "ds": sr, "egos": cavs})


def timed(result: ScenarioResult, reference: Mapping[str, int], mode: ScoreMode = ScoreMode.MDRIVE) -> ScenarioResult:
    limits = {ego.id: 400 for ego in result.egos}
    return apply_reference_times(result, reference, mode, limits)


LIMITS = {"0": 200, "1": 100}


def test_in_mode_hard_each_cav_pays_for_its_time() -> None:
    """The first needs 1.25 x 80 ticks, the second is faster than the reference: (80 + 100) / 2."""
    cavs = (cav("0", 100), cav("1", 40))
    found = apply_reference_times(driven(*cavs), {"0": 80, "1": 50}, ScoreMode.HARD, LIMITS)
    assert [ego.time_factor for ego in found.egos] == [0.8, 1.0]
    assert (found.ds, found.sr, found.time_ratio) == (90.0, 100.0, 1.025)
    assert [ego.ds for ego in found.egos] == [100.0, 100.0]  # RC x IP, as in the other modes


@given(
    reference=st.integers(1, 400),
    slack=st.integers(0, 400),
    ticks=st.integers(1, 800),
    factor=st.sampled_from([0.5, 0.6, 0.7, 0.8, 0.999]),
    rc=st.floats(0.0, 99.0),
)
def test_haste_never_buys_back_an_infraction_or_a_route_not_completed(
    reference: int, slack: int, ticks: int, factor: float, rc: float
) -> None:
    """The slowest clean arrival beats the fastest drive with an infraction, and every drive that does not arrive."""
    limit = reference + slack
    clean = cav("0", limit)
    hasty = cav("0", ticks).model_copy(update={"ip": factor, "ds": 100.0 * factor})
    lost = cav("0", ticks, ds=rc, outcome=End.DEVIATED).model_copy(update={"rc": rc})
    scores = [
        apply_reference_times(driven(one), {"0": reference}, ScoreMode.HARD, {"0": limit}).ds
        for one in (clean, hasty, lost)
    ]
    assert scores[0] == pytest.approx(100.0 * reference / limit, abs=1e-4)
    assert scores[0] > max(scores[1:])
    assert scores[1:] == pytest.approx([factor * scores[0], rc / 100.0 * scores[0]], abs=1e-3)


def test_mode_hard_refuses_a_scenario_without_reference_times() -> None:
    with pytest.raises(InputError, match=r"scenario a: score mode hard: expected times of omniscient for every CAV in"):
        apply_reference_times(driven(cav("0", 50)), {}, ScoreMode.HARD, LIMITS)
    with pytest.raises(InputError, match="score mode hard"):
        score_episode(pair_episode(), PAIR, ROADS, ScoreMode.HARD, 1)


def test_results_of_mode_hard_are_checked_against_their_time_factors() -> None:
    reference = {"0": 60, "1": 60}
    scored = score_episode(pair_episode(), PAIR, ROADS, ScoreMode.HARD, 1, reference)
    limit = compute_time_limit_ticks(PAIR)["0"]
    assert [ego.time_factor for ego in scored.egos] == pytest.approx([60 / limit] * 2, abs=1e-6)
    assert list(find_scenario_faults(scored, ScoreMode.HARD, (1,))) == []
    assert any("time_factor: expected none" in fault for fault in find_scenario_faults(scored, ScoreMode.MDRIVE, (1,)))
    forged = scored.model_copy(update={"ds": scored.ds + 1.0})
    assert any(".ds: expected" in fault for fault in find_scenario_faults(forged, ScoreMode.HARD, (1,)))
    plain = score_episode(pair_episode(), PAIR, ROADS, ScoreMode.MDRIVE, 1, reference)
    assert any("expected a factor" in fault for fault in find_scenario_faults(plain, ScoreMode.HARD, (1,)))
    assert "time_factor" not in plain.model_dump_json()


def test_the_time_ratio_is_the_mean_over_the_cavs() -> None:
    """(100 / 50 + 30 / 60) / 2 = 1.25; both are within twice the reference."""
    found = timed(driven(cav("0", 100), cav("1", 30)), {"0": 50, "1": 60})
    assert [ego.time_ratio for ego in found.egos] == [2.0, 0.5]
    assert (found.time_ratio, found.efficient_sr) == (1.25, 100.0)


def test_a_success_that_takes_more_than_twice_as_long_is_not_efficient() -> None:
    found = timed(driven(cav("0", 101), cav("1", 60)), {"0": 50, "1": 60})
    assert (found.time_ratio, found.efficient_sr) == (1.51, 50.0)


def test_a_scenario_in_which_a_cav_does_not_arrive_has_no_time_ratio() -> None:
    found = timed(driven(cav("0", 50), cav("1", 20, outcome=End.BLOCKED), sr=50.0), {"0": 50, "1": 60})
    assert [ego.time_ratio for ego in found.egos] == [1.0, None]
    assert (found.time_ratio, found.efficient_sr) == (None, 50.0)


def test_an_arrival_with_a_penalty_is_no_efficient_success() -> None:
    found = timed(driven(cav("0", 50, ds=60.0), sr=0.0), {"0": 50})
    assert (found.time_ratio, found.efficient_sr) == (1.0, 0.0)


@pytest.mark.parametrize("mode", [ScoreMode.INTERDRIVE_FIXED, ScoreMode.INTERDRIVE_ASIS])
def test_in_the_modes_of_interdrive_a_scenario_succeeds_as_a_whole(mode: ScoreMode) -> None:
    reference = {"0": 50, "1": 60}
    assert timed(driven(cav("0", 100, ds=70.0), cav("1", 60)), reference, mode).efficient_sr == 100.0
    assert timed(driven(cav("0", 101), cav("1", 60)), reference, mode).efficient_sr == 0.0
    assert timed(driven(cav("0", 100), cav("1", 60), sr=0.0), reference, mode).efficient_sr == 0.0


def test_without_a_reference_both_are_undefined_also_where_they_were_not() -> None:
    found = timed(timed(driven(cav("0", 50)), {"0": 50}), {})
    assert (found.time_ratio, found.efficient_sr, found.egos[0].time_ratio) == (None, None, None)


def test_a_void_scenario_counts_as_no_success_where_there_is_a_reference() -> None:
    void = make_void_result(scenario(id="v"), 1, "SUMO stopped")
    assert (timed(void, {"0": 50}).efficient_sr, timed(void, {"0": 50}).time_ratio) == (0.0, None)
    assert timed(void, {}).efficient_sr is None


def test_results_of_version_2_have_no_ticks_to_compare() -> None:
    found = timed(driven(cav("0", None)), {"0": 50})
    assert found.time_ratio is None


def test_means_are_over_the_scenarios_in_which_they_are_defined() -> None:
    """Bucket One: 1.0 and 3.0, and a scenario that nobody finished; bucket Two: 1.5. Bucket mean (2 + 1.5) / 2."""
    reference = {"0": 100}
    rows = [
        timed(driven(cav("0", 100), name="a"), reference),
        timed(driven(cav("0", 300), name="b"), reference),
        timed(driven(cav("0", 90, outcome=End.TIMED_OUT), sr=0.0, name="c"), reference),
        timed(driven(cav("0", 150), name="d", bucket="Two"), reference),
        driven(cav("0", 150), name="e", bucket="Two"),
    ]
    found = summarize_run(RUN, rows)
    one, two = found.buckets["One"], found.buckets["Two"]
    assert (one.time_ratio, one.timed, one.efficient_sr) == (2.0, 2, 33.333333)
    assert (two.time_ratio, two.timed, two.efficient_sr) == (1.5, 1, 100.0)
    assert (found.overall.bucket_mean.time_ratio, found.overall.timed) == (1.75, 3)
    assert found.overall.scenario_mean.time_ratio == pytest.approx(5.5 / 3, abs=1e-6)
    assert found.overall.scenario_mean.efficient_sr == 50.0


def test_the_ticks_of_a_cav_run_from_the_start_to_its_end() -> None:
    episode = pair_episode()
    found = score_episode(episode, PAIR, ROADS, ScoreMode.MDRIVE, 1, {"0": 101, "1": 50})
    assert [ego.ticks for ego in found.egos] == [episode.find_ending(name).tick for name in "01"]
    assert [ego.time_ratio for ego in found.egos] == [round(found.egos[0].ticks / 101, 6), None]  # type: ignore[operator]
    assert find_arrival_ticks(found.egos) == {"0": found.egos[0].ticks}


cavs = st.tuples(st.integers(1, 400), st.sampled_from([100.0, 99.96, 99.95, 80.0]), st.sampled_from(End))


@given(st.lists(st.tuples(cavs, st.integers(1, 200)), min_size=1, max_size=5), st.sampled_from(ScoreMode))
def test_the_oracle_agrees(rows: list[tuple[tuple[int, float, End], int]], mode: ScoreMode) -> None:
    """The definitions of docs/scoring.md, in fractions; efficient SR never exceeds SR."""
    good = [ds > 99.95 and end is End.ARRIVED for (_, ds, end), _ in rows]
    early = [end is End.ARRIVED and ticks <= 2 * base for (ticks, _, end), base in rows]
    whole = mode not in (ScoreMode.MDRIVE, ScoreMode.HARD)
    sr = 100.0 * all(good) if whole else 100.0 * sum(good) / len(rows)
    result = driven(*(cav(str(i), ticks, ds, end) for i, ((ticks, ds, end), _) in enumerate(rows)), sr=sr)
    found = timed(result, {str(i): base for i, (_, base) in enumerate(rows)}, mode)
    arrived = all(end is End.ARRIVED for (_, _, end), _ in rows)
    ratio = sum(ticks / base for (ticks, _, _), base in rows) / len(rows)
    assert found.time_ratio == (pytest.approx(ratio, abs=1e-5) if arrived else None)
    both = [a and b for a, b in zip(good, early, strict=True)]
    wanted = 100.0 * (all(good) and all(early)) if whole else 100.0 * sum(both) / len(rows)
    assert found.efficient_sr == pytest.approx(wanted, abs=1e-5)
    assert found.efficient_sr is not None and found.efficient_sr <= result.sr + 1e-5
    assert timed(found, {str(i): base for i, (_, base) in enumerate(rows)}, mode) == found


def test_a_suite_of_bucket_hard_is_scored_in_mode_hard(tmp_path: Path) -> None:
    assert set(get_args(ScoreModeName)) == {mode.value for mode in ScoreMode}
    hard = Suite(SuiteFile(name="h", title="h"), tmp_path, (scenario(id="a", bucket="Hard"),))
    mixed = replace(hard, scenarios=(*hard.scenarios, scenario(id="b", bucket="Other")))
    stated = replace(mixed, about=SuiteFile(name="h", title="h", score_mode="hard"))
    assert [suite.score_mode for suite in (hard, mixed, stated)] == ["hard", "mdrive", "hard"]
    assert "score_mode" not in mixed.about.model_dump_json()
