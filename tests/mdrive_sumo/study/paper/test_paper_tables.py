"""Tables of the study from results made by hand."""

from collections.abc import Sequence

import numpy as np
import pytest
from testing.human_study import make_plan
from testing.study_samples import make_row, make_run, make_scenario

from mdrive_sumo.agents.registry import AGENTS, DETECTOR_AGENTS
from mdrive_sumo.core.statistics import bootstrap_nested
from mdrive_sumo.core.tables import format_cell
from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.report.comparison_report.comparison_report import ReportSection
from mdrive_sumo.report.published_results import AS_PUBLISHED, BUCKETS, PUBLISHED_GAPS, PUBLISHED_LATENCY
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.human.human_report import NO_PERSON
from mdrive_sumo.study.human.human_results import CavScore, HumanDrive, HumanStudyResults
from mdrive_sumo.study.paper.cooperation_gain import (
    LEARNED_PAIRS,
    PAIRS,
    PairGain,
    compute_pair_gains,
    compute_role_gaps,
    split_learned_gap,
)
from mdrive_sumo.study.paper.open_closed import OpenClosedComparison
from mdrive_sumo.study.paper.paper_agents import AgentRole, find_role
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_plan import PaperPlan, PaperScale
from mdrive_sumo.study.paper.paper_report import PaperRequest, build_paper_report
from mdrive_sumo.study.paper.paper_study import CONDITIONS
from mdrive_sumo.study.paper.paper_tables import (
    build_channel_table,
    build_gap_table,
    build_pair_table,
    build_scenario_table,
)

CLEAN, LATENCY, POSE_ERROR = CONDITIONS


def test_the_conditions_are_the_papers() -> None:
    assert CLEAN.comm.link.latency_ticks == CLEAN.comm.link.pose_error_m == 0
    assert LATENCY.comm.link.latency_ticks == 6 and LATENCY.comm.link.pose_error_m == 0
    assert (POSE_ERROR.comm.link.pose_error_m, POSE_ERROR.comm.link.pose_error_deg) == (0.6, 0.6)
    assert POSE_ERROR.comm.link.latency_ticks == 0


def test_differences_to_the_clean_channel_are_paired_and_void_scenarios_left_out() -> None:
    clean = [make_scenario(f"s{place}", 50.0 + 4 * place) for place in range(11)]
    worse = [make_scenario(f"s{place}", 44.0 + 4 * place) for place in range(11)]
    void = worse[10].model_copy(update={"status": "void", "ds": 0.0})
    rows = [make_row("talker", CLEAN, *clean), make_row("talker", LATENCY, *worse[:10], void)]
    table = build_channel_table("latency", "Latency", rows, (CLEAN, LATENCY), PUBLISHED_LATENCY)
    cells = {column.key: cell for column, cell in zip(table.columns, table.rows[0].cells, strict=True)}
    assert (cells["ds_clean"].value, cells["ds_perturbed"].value) == (68.0, 62.0), "without s10"
    difference = cells["ds_difference"]
    assert difference.value == -6.0 and difference.interval is not None
    assert difference.interval.ends == pytest.approx((-6.0, -6.0))
    assert cells["rc_difference"].interval is None
    few = build_channel_table("latency", "", [make_row("a", CLEAN, *clean[:4]), make_row("a", LATENCY, *worse[:4])],
                              (CLEAN, LATENCY), ())  # fmt: skip
    assert format_cell(few.rows[0].cells[3], few.columns[3]) == "-6.00 [too few]"
    published = table.rows[1].cells
    assert [cell.value for cell in published[:4]] == ["CoDriving", 92.85, 84.59, pytest.approx(-8.26)]
    assert not table.rows[1].is_ranked


def runs() -> dict[str, Results]:
    """One scenario a level and bucket; SR is DS, so H is DS."""
    places = {"construction": 0, "crosswalk": 10, "deadlock": 20}
    gains = {"idm": 0.0, "single": 10.0, "sharing": 15.0, "sharing+negotiation": 25.0}
    labels = {
        "idm": ("single",),
        "single": ("single",),
        "sharing": ("sharing",),
        "sharing+negotiation": ("negotiation",),
    }
    return {
        agent: make_run(
            *(
                make_scenario(
                    f"{category}{i}",
                    40.0 + place + gain + i,
                    bucket="Interaction",
                    category=category,
                    exchanged=_list_exchanged(labels[agent]),
                )
                for category, place in places.items()
                for i in range(5)
            ),
            agent=agent,
        )
        for agent, gain in gains.items()
    }


def _list_exchanged(labels: tuple[str, ...]) -> dict[str, int]:
    return {"sharing": {"cam": 1}, "negotiation": {"mcm": 1}}.get(labels[0], {})


@pytest.mark.slow
def test_the_gap_of_roles_is_between_the_means_of_their_agents() -> None:
    found = runs()
    assert {name: find_role(run) for name, run in found.items()} == {
        "idm": AgentRole.SINGLE,
        "single": AgentRole.SINGLE,
        "sharing": AgentRole.MULTI,
        "sharing+negotiation": AgentRole.MULTI,
    }
    bound = make_run(make_scenario("s", 1.0), agent="stationary")
    gaps = {one.group: one for one in compute_role_gaps({**found, "stationary": bound})}
    assert list(gaps) == ["Interaction", "static-avoidance", "dynamic-avoidance", "dynamic-coordination", "all"]
    static = gaps["static-avoidance"]
    assert (static.multi, static.single, static.gap.mean) == pytest.approx((62.0, 47.0, 15.0))
    assert static.gap.ends is None and static.scenarios == static.gap.units == 5
    table = build_gap_table(tuple(gaps.values()))
    assert [cell.value for cell in table.find_column("paper")] == [None, *PUBLISHED_GAPS.values(), None]
    assert [cell.value for cell in table.find_column("shown")][1:4] == ["too few places"] * 3
    assert compute_role_gaps({"idm": found["idm"]}) == ()


@pytest.mark.slow
def test_pairs_of_agents_with_one_planner_are_compared_scenario_by_scenario() -> None:
    gains = compute_pair_gains(runs())
    assert {(one.agent, one.base) for one in gains} == {
        ("sharing", "single"), ("sharing+negotiation", "sharing"), ("sharing+negotiation", "single"),
    }  # fmt: skip
    whole = {(one.agent, one.base): one.ds.mean for one in gains if one.group == "all"}
    assert [*whole.values()] == pytest.approx([5.0, 10.0, 15.0])
    table = build_pair_table(gains)
    assert table.rows[0].section == "perception sharing: sharing - single"


@pytest.mark.slow
@pytest.mark.usefixtures("intervals_of_few")
def test_the_gap_of_learned_systems_is_split_into_messages_and_the_rest() -> None:
    """H of the networks is 50 and 60, of codriving 80, of its twin without messages 72: 25 = 8 + 17."""
    scores = {"tcp": 50.0, "vad": 60.0, "codriving": 80.0, "codriving:alone": 72.0, "perception-swap:none": 1.0}
    found = {
        agent: make_run(*(make_scenario(f"s{place}", ds) for place in range(3)), agent=agent)
        for agent, ds in scores.items()
    }
    gaps = split_learned_gap(found)
    whole = {one.part: one.gap.mean for one in gaps if one.group == "all"}
    assert [*whole.values()] == pytest.approx([25.0, 8.0, 17.0])
    table = build_gap_table(gaps)
    assert table.name == "gap_learned" and [name for name, _ in table.sections] == [*whole]
    assert next(iter(whole)) == "learned systems: codriving minus tcp, vad"
    assert split_learned_gap({name: run for name, run in found.items() if name != "codriving:alone"}) == ()
    assert split_learned_gap({name: run for name, run in found.items() if name.startswith("codriving")}) == ()
    gains = compute_pair_gains(found, LEARNED_PAIRS)
    assert {(one.agent, one.base, one.ds.mean) for one in gains} == {("codriving", "codriving:alone", 8.0)}


def test_learned_pairs_are_agents_that_differ_in_messages() -> None:
    assert {*AGENTS} >= {name for pair in PAIRS for name in pair}
    shares = {agent for agent, _ in LEARNED_PAIRS}
    assert shares == {name for name in DETECTOR_AGENTS if "alone" not in name and not name.endswith(":none")}
    assert {find_role(make_run(make_scenario("s", 1.0), agent=name)) for name in DETECTOR_AGENTS} == {
        AgentRole.DETECTOR, AgentRole.SINGLE,
    }  # fmt: skip


def test_scenarios_stand_beside_those_of_the_paper() -> None:
    table = build_scenario_table(load_suite("interdrive@0").scenarios)
    values = dict(
        zip((column.key for column in table.columns), (cell.value for cell in table.rows[0].cells), strict=True)
    )
    assert (values["scenarios_driven"], values["scenarios_paper"]) == (46.0, 46.0)
    assert values["route_m_paper"] == 51.83
    assert len(table.rows) == 1, "InterDrive has no categories in the paper's table"


def test_few_scenarios_show_nothing() -> None:
    few = [PairGain("sharing", "single", "all", 9, *[bootstrap_nested(np.full(9, 3.0), [(i,) for i in range(9)])] * 2)]
    cells = [cell for row in build_pair_table(few).rows for cell in row.cells]
    assert [cell.value for cell in cells[-2:]] == ["too few places"] * 2
    assert not any(cell.interval and cell.interval.ends for cell in cells)


def make_numbers(scale: PaperScale, suite: str = "interdrive@0", buckets: Sequence[str] = BUCKETS) -> PaperNumbers:
    """Two agents with one scenario in each bucket, and nothing in open loop."""
    driven = {
        agent: make_run(*(make_scenario(bucket, ds, bucket=bucket) for bucket in buckets), agent=agent)
        for agent, ds in (("idm", 50.0), ("single", 60.0))
    }
    return PaperNumbers(
        plan=PaperPlan(scale, ("s",), ("s",), ("s",)),
        scenarios=load_suite(suite).scenarios,
        closed=driven,
        open={},
        channel=(),
        compared=make_agents_of_results(driven.values()),
        gaps=(),
        learned_gaps=(),
        gains=(),
        learned_gains=(),
        comparison=OpenClosedComparison(0, (), ()),
        precisions={},
        detectors={},
        precision_correlations=(),
    )


@pytest.mark.parametrize("scale", PaperScale)
def test_published_rows_stand_beside_ours_but_in_a_quick_study(scale: PaperScale) -> None:
    report = build_paper_report(make_numbers(scale), PaperRequest(("mdrive-sumo",), {"colmdriver": "no model"}))
    main = next(table for table in report.tables if table.name.endswith("main"))
    sections = [name for name, _ in main.sections]
    assert (AS_PUBLISHED in sections) == (scale is not PaperScale.QUICK)
    assert ("ours are over a share of each category" in main.note) == (scale is PaperScale.STANDARD)
    assert not any(row.is_ranked for row in main.rows if row.section == AS_PUBLISHED)
    assert any("colmdriver: no model" in warning for warning in report.warnings)
    gains = next(section for section in report.sections if "gain" in section.title)
    assert gains.tables == () and "sharing and single" in gains.note
    for section in report.sections[:-1]:
        assert {"Counterpart of", "Comparable to CARLA", "Not comparable"} <= {*section.points}, section.title


def test_no_published_rows_stand_beside_other_scenarios() -> None:
    """The study on `hard`: no row of the paper, in whatever table, and a warning before the numbers."""
    report = build_paper_report(make_numbers(PaperScale.WHOLE, "hard@0", ("Hard",)), PaperRequest(("mdrive-sumo",), {}))
    assert not [table.name for table in report.tables if AS_PUBLISHED in dict(table.sections)]
    assert any("none of the paper's buckets" in warning for warning in report.warnings)
    logs = build_paper_report(make_numbers(PaperScale.WHOLE, "v2xpnp@0"), PaperRequest(("mdrive-sumo",), {}))
    assert sum(AS_PUBLISHED in dict(table.sections) for table in logs.tables) == 3
    assert not logs.warnings


def test_the_row_of_persons_is_marked_until_somebody_has_driven() -> None:
    """No study, one of programs only, one of a person: of RQ4 there is no number that nobody drove."""
    numbers = make_numbers(PaperScale.STANDARD)
    plan = make_plan(conditions=[{"name": "a"}])

    def find_section(humans: HumanStudyResults | None) -> ReportSection:
        report = build_paper_report(numbers, PaperRequest(("mdrive-sumo",), {}, humans))
        return next(section for section in report.sections if "RQ4" in section.title)

    def drive(driver: str) -> HumanStudyResults:
        score = CavScore("a", 80.0, 0.0, 80.0, 1.0, None, None, "blocked", 0)
        drives = (HumanDrive("P01", driver, 1, "a", "0", score, 80.0, 0.0, 0, "wheel", {}),)
        return HumanStudyResults(plan, drives, {"sharing": (score,)}, {}, 0)

    assert NO_PERSON in find_section(None).note and not find_section(None).tables
    scripted = find_section(drive("scripted:attentive"))
    assert scripted.note == NO_PERSON and scripted.tables[0].rows[0].cells[1].value == NO_PERSON
    person = find_section(drive("person"))
    assert person.note == ""
    assert [cell.value for cell in person.tables[0].rows[0].cells[:6]] == ["persons", "a", 1.0, 1.0, 1.0, 80.0]
    assert not any(cell.value == NO_PERSON for row in person.tables[0].rows for cell in row.cells)
    (gap,) = person.tables[1:]
    assert [cell.value for cell in gap.rows[0].cells[:4]] == ["sharing", "persons", 0.0, 0.0]
