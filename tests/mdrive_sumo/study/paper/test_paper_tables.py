"""Tables of the study from results made by hand."""

import pytest
from testing.study_samples import make_row, make_run, make_scenario

from mdrive_sumo.report.published_results import PUBLISHED_GAPS, PUBLISHED_LATENCY
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.channel_table import build_channel_table
from mdrive_sumo.study.paper.cooperation_gain import compute_pair_gains, compute_role_gaps
from mdrive_sumo.study.paper.gain_tables import build_gap_table, build_pair_table
from mdrive_sumo.study.paper.paper_agents import AgentRole, find_role
from mdrive_sumo.study.paper.paper_study import CONDITIONS
from mdrive_sumo.study.paper.scenario_table import build_scenario_table

CLEAN, LATENCY, POSE_ERROR = CONDITIONS


def test_the_conditions_are_the_papers() -> None:
    assert CLEAN.comm.link.latency_ticks == CLEAN.comm.link.pose_error_m == 0
    assert LATENCY.comm.link.latency_ticks == 6 and LATENCY.comm.link.pose_error_m == 0
    assert (POSE_ERROR.comm.link.pose_error_m, POSE_ERROR.comm.link.pose_error_deg) == (0.6, 0.6)
    assert POSE_ERROR.comm.link.latency_ticks == 0


def test_differences_to_the_clean_channel_are_paired_and_void_scenarios_left_out() -> None:
    clean = [make_scenario(f"s{place}", 50.0 + 10 * place) for place in range(4)]
    worse = [make_scenario(f"s{place}", 44.0 + 10 * place) for place in range(4)]
    void = worse[3].model_copy(update={"status": "void", "ds": 0.0})
    rows = [make_row("talker", CLEAN, *clean), make_row("talker", LATENCY, *worse[:3], void)]
    table = build_channel_table("latency", "Latency", rows, (CLEAN, LATENCY), PUBLISHED_LATENCY)
    cells = {column.key: cell for column, cell in zip(table.columns, table.rows[0].cells, strict=True)}
    assert (cells["ds_clean"].value, cells["ds_perturbed"].value) == (60.0, 54.0), "without s3"
    difference = cells["ds_difference"]
    assert difference.value == -6.0 and difference.interval is not None
    assert difference.interval.low == pytest.approx(-6.0) and difference.interval.high == pytest.approx(-6.0)
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
                for i in range(2)
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
    assert (static.multi, static.single, static.gap.mean) == pytest.approx((60.5, 45.5, 15.0))
    assert static.gap.low == pytest.approx(15.0) and static.scenarios == 2
    table = build_gap_table(tuple(gaps.values()))
    assert [cell.value for cell in table.find_column("paper")] == [None, *PUBLISHED_GAPS.values(), None]
    assert {cell.value for cell in table.find_column("shown")} == {"gain"}
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


def test_scenarios_stand_beside_those_of_the_paper() -> None:
    table = build_scenario_table(load_suite("interdrive").scenarios)
    values = dict(
        zip((column.key for column in table.columns), (cell.value for cell in table.rows[0].cells), strict=True)
    )
    assert (values["scenarios_driven"], values["scenarios_paper"]) == (46.0, 46.0)
    assert values["route_m_paper"] == 51.83
    assert len(table.rows) == 1, "InterDrive has no categories in the paper's table"
