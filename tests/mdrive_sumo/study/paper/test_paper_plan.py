"""Which scenarios each part of the study drives."""

from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.study.paper.paper_plan import (
    CHANNEL_SCENARIOS,
    MIN_STRATUM,
    PaperScale,
    choose_evenly,
    choose_shortest,
    make_plan,
    name_stratum,
)
from mdrive_sumo.study.paper.paper_study import PaperStudy


@pytest.fixture(scope="module")
def mdrive() -> Suite:
    return load_suite("mdrive@0")


@pytest.mark.slow
def test_the_whole_study_drives_every_scenario_and_21_logs_over_worse_channels(mdrive: Suite) -> None:
    plan = make_plan(mdrive, PaperScale.WHOLE)
    assert len(plan.closed) == 225 and len(plan.logs) == 67
    assert len(plan.channel) == len({*plan.channel}) == CHANNEL_SCENARIOS == 21
    assert {*plan.channel} <= {*plan.logs} <= {*plan.closed}
    by_id = {scenario.id: scenario for scenario in mdrive}
    assert all(len(by_id[name].egos) > 1 for name in plan.channel), "a message needs a receiver"
    assert {by_id[name].network for name in plan.channel} == {by_id[name].network for name in plan.logs}


def test_a_quick_study_has_every_stratum_once_and_is_always_the_same(mdrive: Suite) -> None:
    plan = make_plan(mdrive, PaperScale.QUICK)
    assert plan == make_plan(mdrive, PaperScale.QUICK)
    assert len(plan.closed) == 8 and {*plan.channel} == {*plan.logs} <= {*plan.closed}
    strata = {name_stratum(scenario) for scenario in mdrive}
    found = [name_stratum(scenario) for scenario in mdrive if scenario.id in {*plan.closed}]
    levels = {"static-avoidance", "dynamic-avoidance", "dynamic-coordination"}
    assert {*found} == strata == {"IC", "LM", "LC", "synthetic"} | levels
    assert found.count("synthetic") == 2


def test_trained_detectors_drive_everything_and_surrogates_what_both_loops_have(mdrive: Suite, tmp_path: Path) -> None:
    """CoDriving is in the two perturbed channels besides, detectors are not; each sees every log in open loop."""
    plan = make_plan(mdrive, PaperScale.STANDARD)
    reference = prepare(RunConfig(suite="mdrive@0", agent=AgentSpec("omniscient"), out=tmp_path))
    closed, logs, channel = len(plan.closed), len(plan.logs), len(plan.channel)
    for agent, driven in (
        ("perception-swap:cobevt", closed),
        ("perception-swap:cobevt:profile", logs),
        ("codriving", closed + 2 * channel),
    ):
        study = PaperStudy(plan, {agent: reference}, reference, tmp_path)
        assert study.episodes() == driven + logs + logs, "of the agent in both loops, and the recorded drives"


def test_the_shortest_routes_are_those_with_the_least_to_drive_together(mdrive: Suite) -> None:
    lengths = [sum(len(ego.route) for ego in scenario.egos) for scenario in mdrive]
    found = choose_shortest(mdrive, 5)
    assert sorted(sum(len(ego.route) for ego in one.egos) for one in found) == sorted(lengths)[:5]
    assert found == [scenario for scenario in mdrive if scenario in found], "in the order of the suite"


def test_a_standard_study_has_a_quarter_of_each_category_and_the_same_worse_channels(mdrive: Suite) -> None:
    plan, whole = make_plan(mdrive, PaperScale.STANDARD), make_plan(mdrive, PaperScale.WHOLE)
    assert plan.channel == whole.channel and {*plan.channel} <= {*plan.logs} <= {*plan.closed} <= {*whole.closed}
    assert len(plan.closed) == 74, "the time of a study on two cores depends on it: docs/studies.md"
    chosen = [scenario for scenario in mdrive if scenario.id in {*plan.closed}]
    assert tuple(scenario.id for scenario in chosen) == plan.closed
    assert {scenario.category for scenario in chosen} == {scenario.category for scenario in mdrive}
    strata = [name_stratum(scenario) for scenario in chosen]
    assert min(map(strata.count, strata)) >= MIN_STRATUM
    alone = [len(scenario.egos) == 1 for scenario in chosen if scenario.id in {*plan.logs}]
    assert sum(alone) / len(alone) == pytest.approx(13 / 67, abs=0.02), "as large a share as in the suite"


def test_a_suite_without_logs_is_compared_as_a_whole(mdrive: Suite) -> None:
    plan = make_plan(load_suite("interdrive@0"), PaperScale.QUICK)
    assert plan.logs == plan.closed and len(plan.closed) == 3
    plan = make_plan(load_suite("hard@0"), PaperScale.STANDARD)
    assert plan.logs == plan.closed == plan.channel and len(plan.closed) > 21, "the paper's 21 are of V2XPnP"


def test_scenarios_with_one_cav_have_no_channel(mdrive: Suite) -> None:
    alone = tuple(scenario for scenario in mdrive if len(scenario.egos) == 1)
    with pytest.raises(InputError, match="two CAVs or more, found none"):
        make_plan(Suite(mdrive.about, mdrive.folder, alone), PaperScale.WHOLE)


@given(st.integers(0, 60), st.integers(1, 25))
def test_even_choices_are_ordered_different_and_spread(size: int, count: int) -> None:
    found = choose_evenly(range(size), count)
    assert len(found) == min(size, count)
    assert found == sorted({*found})
    if size > count:
        gaps = [b - a for a, b in pairwise(found)]
        assert max(gaps, default=0) - min(gaps, default=0) <= 1
