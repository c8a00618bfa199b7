"""What the tables of a report say: golden main table, published rows, categories, scalars, infractions, matrix."""

from statistics import harmonic_mean

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.report_samples import BEST, CRASH, SHARING, SINGLE, make_agent_run, make_sample_runs

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_markdown
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent, make_agents_of_results
from mdrive_sumo.report.comparison_report.cooperation_table import build_cooperation_table
from mdrive_sumo.report.comparison_report.outcome_tables import (
    build_infraction_table,
    build_outcome_table,
    build_scalar_table,
)
from mdrive_sumo.report.comparison_report.provenance_table import build_provenance_table, list_facts, list_warnings
from mdrive_sumo.report.comparison_report.ranking_table import build_ranking_table
from mdrive_sumo.report.comparison_report.scenario_tables import (
    build_category_table,
    build_distribution_table,
    build_interdrive_table,
    build_level_table,
    build_scenario_table,
    compute_distribution,
)
from mdrive_sumo.report.comparison_report.score_tables import build_bucket_table, build_main_table
from mdrive_sumo.report.published_results import (
    BUCKET_SIZES,
    BUCKETS,
    PUBLISHED_LATENCY,
    PUBLISHED_METHODS,
    PUBLISHED_POSE_ERROR,
    check_published_rows,
    order_buckets,
)
from mdrive_sumo.scoring import Means, compute_harmonic_mean, summarize_run
from mdrive_sumo.scoring.captured_cooperation import compute_captured_cooperation
from mdrive_sumo.scoring.intervals import BUCKET_MEAN

GOLDEN = """\
| Agent | Sharing | Negotiation | InterDrive DS | InterDrive SR | Interaction DS | Interaction SR | V2XPnP DS\
 | V2XPnP SR | Overall DS | Overall SR | Overall eff. SR | Overall time ratio |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
| *Single-agent* |  |  |  |  |  |  |  |  |  |  |  |  |
| single | × | × | 60.00 ± 0.00 (2) | 25.00 ± 25.00 (2) | 66.67 ± 40.00 (2) | 50.00 ± 50.00 (2) | 100.00 ± 0.00\
 | 100.00 ± 0.00 | 75.56 ± 13.33 (2) | 58.33 ± 19.44 (2) | 58.33 (2) | 1.50 |
| sharing (channel off) | × | × | 60.00 ± 0.00 | 25.00 ± 25.00 | 66.67 ± 40.00 | 50.00 ± 50.00 | 100.00 ± 0.00\
 | 100.00 ± 0.00 | 75.56 ± 13.33 | 58.33 ± 19.44 | 58.33 | 1.50 |
| *Multi-agent* |  |  |  |  |  |  |  |  |  |  |  |  |
| sharing (channel ideal) | ✓ | × | **80.00 ± 20.00** | **50.00 ± 50.00** | **86.67 ± 10.00**\
 | **66.67 ± 25.00** | 100.00 ± 0.00 | 100.00 ± 0.00 | **88.89 ± 8.89** | **72.22 ± 22.22** | **72.22** | 1.50 |
| *Privileged: an upper bound, not ranked* |  |  |  |  |  |  |  |  |  |  |  |  |
| omniscient | × | × | 100.00 ± 0.00 | 100.00 ± 0.00 | 100.00 ± 0.00 | 100.00 ± 0.00 | 100.00 ± 0.00\
 | 100.00 ± 0.00 | 100.00 ± 0.00 | 100.00 ± 0.00 | 100.00 | 1.50 |"""


@pytest.fixture(scope="module")
def agents() -> tuple[ComparedAgent, ...]:
    return make_agents_of_results(make_sample_runs().values())


@pytest.mark.usefixtures("intervals_of_few")
def test_the_main_table_is_the_golden_one() -> None:
    assert format_markdown(build_main_table(make_agents_of_results(make_sample_runs().values()))) == GOLDEN


def test_the_ranking_stands_by_track_and_says_when_intervals_are_missing() -> None:
    runs = (
        make_agent_run("single", SINGLE),
        make_agent_run("sharing", SHARING, exchanged=("cam",)),
        make_agent_run("blind", SINGLE, track="sensor"),
        make_agent_run("omniscient", BEST, labels=("privileged",)),
    )
    table = build_ranking_table(make_agents_of_results(runs))
    assert table is not None and "Too few places for intervals (6): ranks go by the ability alone." in table.note
    found = [(row.section, row.cells[0].value, row.cells[1].value) for row in table.rows]
    assert found == [
        ("Object track", "sharing", 1.0),
        ("Object track", "single", 2.0),
        ("Sensor track", "blind", 1.0),
        ("Privileged: an upper bound, not ranked", "omniscient", None),
    ]
    alone = build_ranking_table(make_agents_of_results([make_agent_run(name, SINGLE) for name in "abc"]))
    assert alone is not None and {row.section for row in alone.rows} == {""}


def test_published_rows_are_set_apart_and_change_no_mark(agents: tuple[ComparedAgent, ...]) -> None:
    table = build_main_table(agents, PUBLISHED_METHODS)
    assert table.rows[: len(agents)] == build_main_table(agents).rows
    rows = table.rows[len(agents) :]
    assert [row.cells[0].value for row in rows] == [method.method for method in PUBLISHED_METHODS]
    assert {row.section for row in rows} == {"CARLA, as published: not ranked"}
    assert not any(cell.rank for row in rows for cell in row.cells)
    assert "tab:mdrive_results" in table.note


def test_a_single_bucket_has_no_overall_column() -> None:
    (agent,) = make_agents_of_results([make_agent_run("idm", {"i01": (100.0,), "i02": (CRASH,)})])
    table = build_main_table([agent], PUBLISHED_METHODS[:1])
    assert [column.group for column in table.columns] == ["", "", "", *["InterDrive"] * 4]
    assert [cell.value for cell in table.rows[1].cells] == ["TCP", False, False, 83.55, 67.80, None, None]
    assert {row.section for row in build_bucket_table([agent]).rows} == {"InterDrive"}


def test_published_averages_are_means_of_their_buckets() -> None:
    """Protocol 8.4: all rows fit to 0.01, which also finds a number that was copied wrongly."""
    for method in PUBLISHED_METHODS:
        for i in range(2):
            assert method.average[i] == pytest.approx(sum(pair[i] for pair in method.scores.values()) / 3, abs=0.0101)
    for row in (*PUBLISHED_LATENCY, *PUBLISHED_POSE_ERROR):
        for rate in row.sr:
            assert rate * 21 / 100 * 2 == pytest.approx(round(rate * 21 / 100 * 2), abs=0.01), "SR of 21 scenarios"


@pytest.mark.parametrize(
    ("suite", "scores", "sentence"),
    [
        ("made-up", SINGLE, "expected a suite of the paper's buckets .*interdrive.*, found made-up"),
        ("interdrive", {"i01": (100.0,)}, "expected all 46 scenarios of InterDrive, .* found 1"),
    ],
)
def test_published_rows_need_whole_buckets_of_the_paper(
    suite: str, scores: dict[str, tuple[float, ...]], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        check_published_rows(make_agent_run("idm", scores, suite=suite))


def test_buckets_have_the_order_of_the_paper() -> None:
    assert order_buckets(["own", "V2XPnP", "Interaction", "InterDrive", "extra"]) == (*BUCKETS, "extra", "own")
    assert sum(BUCKET_SIZES.values()) == 225


@given(ds=st.floats(0.01, 100), sr=st.floats(0.01, 100))
def test_h_is_a_harmonic_mean(ds: float, sr: float) -> None:
    h = compute_harmonic_mean(Means(ds=ds, sr=sr, rc=0, ip=0))
    assert h == pytest.approx(harmonic_mean([round(ds, 6), round(sr, 6)]))
    assert min(ds, sr) - 1e-5 <= h <= (ds + sr) / 2 + 1e-5
    assert h == compute_harmonic_mean(Means(ds=sr, sr=ds, rc=0, ip=0))


def test_levels_take_the_means_first(agents: tuple[ComparedAgent, ...]) -> None:
    table = build_level_table(agents)
    assert table is not None and table.columns[1].group == "static-avoidance (1)"
    place = [agent.name for agent in agents].index("sharing (channel ideal)")
    found = {column.key: table.find_column(column.key)[place].value for column in table.columns}
    assert found["dynamic-avoidance_ds"] == 80 and found["dynamic-avoidance_sr"] == 50
    assert found["dynamic-avoidance_h"] == pytest.approx(harmonic_mean([80, 50]))
    assert build_level_table(make_agents_of_results([make_agent_run("a", {"i01": (1.0,)})])) is None


def test_groups_and_categories_of_interdrive(agents: tuple[ComparedAgent, ...]) -> None:
    groups = build_interdrive_table(agents)
    assert groups is not None and [name for name, _ in groups.groups] == ["", "IC (1)", "LM (1)"]
    table = build_category_table(agents, "ds")
    assert [(row.section, row.cells[0].value) for row in table.rows][:3] == [
        ("InterDrive", "ins_c"),
        ("InterDrive", "ins_ss"),
        ("Interaction", "construction"),
    ]
    ranks = [cell.rank for cell in table.rows[1].cells]
    assert ranks == [0, 0, 2, 0, 1, 0], "without a channel, and omniscient, do not compete"


def test_a_category_of_two_buckets_is_two_rows() -> None:
    run = make_agent_run("a", {"i01": (100.0,), "log": (50.0,)})
    same = [one.model_copy(update={"category": "same"}) for one in run.scenarios]
    table = build_category_table(make_agents_of_results([summarize_run(run.run, same)]), "ds")
    assert [(row.section, row.cells[2].value) for row in table.rows] == [("InterDrive", 100), ("V2XPnP", 50)]


def test_infractions_are_counted_per_drive(agents: tuple[ComparedAgent, ...]) -> None:
    table = build_infraction_table(agents)
    drives = dict(zip((agent.name for agent in agents), table.find_column("drives"), strict=True))
    assert drives["single"].value == 22 and drives["sharing (channel off)"].value == 22
    crashes = [cell.value for cell in table.find_column("collision-vehicle")]
    assert crashes[:2] == pytest.approx([100 * 3 / 11] * 2), "two seeds do not double a rate"
    assert [cell.value for cell in table.find_column("impact: 1 to 5 m/s")] == crashes
    outcomes = build_outcome_table(agents)
    shares = [outcomes.find_column(name)[0].number or 0 for name in ("arrived", "blocked")]
    assert shares == pytest.approx([100 * 8 / 11, 100 * 3 / 11]) and outcomes.find_column("void")[0].value == 0


def test_the_distribution_has_every_episode_once(agents: tuple[ComparedAgent, ...]) -> None:
    for row in build_distribution_table(agents).rows:
        assert sum(cell.number or 0 for cell in row.cells) == pytest.approx(100)
    scores = {"i01": (0.0,), "i02": (20.0,), "cone": (99.95,), "walker": (99.96,), "left": (100.0,), "log": (19.99,)}
    (agent,) = make_agents_of_results([make_agent_run("a", scores)])
    found = compute_distribution(agent.results.scenarios)
    assert [round(6 * share / 100) for share in found.values()] == [2, 1, 0, 0, 1, 2]


def test_the_matrix_has_the_mean_over_seeds_and_the_hardest_first() -> None:
    pooled = [make_agent_run("a", SINGLE), make_agent_run("a", BEST, (1,)), make_agent_run("b", {**BEST, "i02": ()})]
    table = build_scenario_table(make_agents_of_results(pooled))
    found = {str(row.cells[0].value): [cell.value for cell in row.cells[2:]] for row in table.rows}
    assert list(found) == ["i02", "i01", "walker", "left", "cone", "log"]
    assert found["i01"] == [80, 100] and found["i02"] == [80, None]


def test_captured_cooperation_is_that_of_the_three_runs(agents: tuple[ComparedAgent, ...]) -> None:
    table = build_cooperation_table(agents)
    runs = make_sample_runs()
    share = compute_captured_cooperation(runs["sharing"], runs["off"], runs["omniscient"])
    assert table is not None and [row.cells[0].value for row in table.rows] == ["sharing (channel ideal)"]
    assert table.find_column("bucket_mean")[0].value == pytest.approx(100 * (share.bucket_mean or 0))
    assert table.find_column("V2XPnP")[0].value is None, "omniscient gains nothing there"
    assert build_cooperation_table([agent for agent in agents if agent.name != "omniscient"]) is None
    other = make_agent_run("omniscient", BEST, labels=("privileged",), actors="original")
    assert build_cooperation_table(make_agents_of_results([runs["sharing"], runs["off"], other])) is None


def test_scalars_by_bucket_and_over_all(agents: tuple[ComparedAgent, ...]) -> None:
    table = build_scalar_table(agents)
    assert [name for name, _ in table.sections] == [*BUCKETS, "all scenarios"]
    row = table.sections[-1][1][0]
    found = {column.key: cell.value for column, cell in zip(table.columns, row.cells, strict=True)}
    assert found["close_calls"] == pytest.approx(100 * 2 / 6) and found["min_ttc"] == 0.5
    assert found["mean_speed"] == 5 and found["min_pet"] is None and found["message_rate"] == 100


def test_provenance_facts_and_warnings() -> None:
    void = make_agent_run("b", {**BEST, "i01": ()}, (0, 1))
    agents = make_agents_of_results([make_agent_run("a", BEST), make_agent_run("a", BEST, (4,)), void])
    table = build_provenance_table(agents)
    assert [row.cells[2].value for row in table.rows] == ["0", "4", "0, 1"]
    assert list_facts(agents)["scenarios"] == "6 (InterDrive 2, Interaction 3, V2XPnP 1)"
    seeds, voids = list_warnings(agents)
    assert "seeds: 0, 4 for a; 0, 1 for b. Differences are paired" in seeds
    assert voids == "b (seeds 0, 1): void episodes count as 0 in means: i01 (seed 0), i01 (seed 1)."
    run = make_agent_run("c", BEST)
    timeless = [one.model_copy(update={"efficient_sr": None}) for one in run.scenarios]
    (missing,) = list_warnings(make_agents_of_results([summarize_run(run.run, timeless)]))
    assert missing.startswith("c: reference times: none for 6 scenarios: `mdrive-sumo validate")
    assert set(agents[0].intervals) >= {BUCKET_MEAN}


def test_agents_of_the_sensor_track_are_ranked_apart() -> None:
    found = make_agents_of_results(
        make_agent_run(name, scores, track=track, exchanged=kinds)
        for name, scores, track, kinds in (
            ("by-lidar", SINGLE, "sensor", ()),
            ("by-lidar-and-words", BEST, "sensor", ("text",)),
            ("worse", SINGLE, "object", ()),
            ("better", BEST, "object", ()),
        )
    )
    table = build_main_table(found)
    assert [(row.section, row.cells[0].value) for row in table.rows] == [
        ("Single-agent", "worse"),
        ("Single-agent", "better"),
        ("Sensor track: single-agent", "by-lidar"),
        ("Sensor track: multi-agent", "by-lidar-and-words"),
    ]
    assert [cell.rank for cell in table.find_column("overall_ds")] == [2, 1, 2, 1]
    assert "ranked apart" in table.note
    row = next(row for row in build_category_table(found, "ds").rows if row.cells[0].value == "crosswalk")
    assert [cell.rank for cell in row.cells[2:]] == [2, 1, 2, 1]
    tracks = build_provenance_table(found).find_column("track")
    assert [cell.value for cell in tracks] == ["object", "object", "sensor", "sensor"]
