"""Which runs are one line of a report, how lines are named, and which runs cannot stand in one report."""

import json
from pathlib import Path
from typing import Any

import pytest
from testing.journals import rewrite_journal
from testing.report_samples import BEST, SHARING, SINGLE, make_agent_run, make_sample_runs, save_run, save_sample_runs

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.comparison_report.compared_agent import (
    MULTI_AGENT,
    SINGLE_AGENT,
    UPPER_BOUND,
    make_agents_of_results,
    make_compared_agents,
)
from mdrive_sumo.report.comparison_report.comparison_report import build_comparison_report
from mdrive_sumo.report.comparison_report.provenance_table import list_warnings
from mdrive_sumo.report.comparison_report.report_runs import ReportRun, load_report_runs, merge_seasons
from mdrive_sumo.report.comparison_report.scenario_tables import build_category_table
from mdrive_sumo.report.comparison_report.score_tables import build_main_table
from mdrive_sumo.report.comparison_report.write_comparison_report import format_report_markdown
from mdrive_sumo.runs.journal import FORMAT
from mdrive_sumo.scoring import Results


def name_all(*results: Results) -> list[str]:
    return [agent.name for agent in make_agents_of_results(results)]


def test_the_samples_are_valid_results(tmp_path: Path) -> None:
    agents = make_compared_agents(load_report_runs(save_sample_runs(tmp_path)))
    assert [(agent.name, agent.section) for agent in agents] == [
        ("single", SINGLE_AGENT),
        ("sharing (channel off)", SINGLE_AGENT),
        ("sharing (channel ideal)", MULTI_AGENT),
        ("omniscient", UPPER_BOUND),
    ]
    assert [agent.is_ranked for agent in agents] == [True, True, True, False]
    assert [agent.shares_perception for agent in agents] == [False, False, True, False]
    assert not any(agent.negotiates for agent in agents)


def test_seeds_of_one_agent_are_pooled() -> None:
    (agent,) = make_agents_of_results([make_agent_run("idm", BEST, (3, 1)), make_agent_run("idm", SINGLE, (2,))])
    assert agent.name == "idm" and agent.seeds == (1, 2, 3) and len(agent.runs) == 2
    assert len(agent.results.scenarios) == 3 * len(SINGLE)
    best, single = (make_agent_run("idm", scores).overall.scenario_mean.ds for scores in (BEST, SINGLE))
    assert agent.results.overall.scenario_mean.ds == pytest.approx((2 * best + single) / 3)
    assert set(agent.intervals) == {*agent.results.buckets, "bucket mean", "scenario mean"}


def test_runs_with_other_settings_are_named_by_what_differs() -> None:
    cams = ("cam",)
    latency = make_agent_run("sharing", SHARING, exchanged=cams, channel="paper-latency")
    odd = make_agent_run("sharing", SHARING, exchanged=cams)
    odd = odd.model_copy(update={"run": odd.run.model_copy(update={"comm": {**odd.run.comm, "loss": 0.25}})})
    assert name_all(latency, odd) == ["sharing (channel paper-latency)", "sharing (channel loss 0.25)"]
    assert name_all(make_agent_run("idm", BEST), make_agent_run("idm", BEST, sensing="perfect")) == [
        "idm (sensing realistic)",
        "idm (sensing perfect)",
    ]
    assert name_all(make_agent_run("idm", BEST), make_agent_run("single", BEST, (0, 2), sensing="perfect")) == [
        "idm (sensing realistic, seed 0)",
        "single (sensing perfect, seeds 0, 2)",
    ]
    assert name_all(make_agent_run("idm", BEST), make_agent_run("single", BEST)) == ["idm", "single"]


def test_the_channel_is_no_condition_of_an_agent_that_exchanges_nothing() -> None:
    silent = make_agent_run("single", SINGLE)
    sharing = make_agent_run("sharing", SHARING, exchanged=("cam",), channel="realistic")
    agents = make_agents_of_results([silent, sharing])
    assert [agent.name for agent in agents] == ["single", "sharing"]
    assert len({agent.rank_group for agent in agents}) == 1 and list_warnings(agents) == ()
    other = make_agent_run("talker", SHARING, exchanged=("text",))
    agents = make_agents_of_results([silent, sharing, other])
    assert [agent.name for agent in agents] == ["single", "sharing (channel realistic)", "talker (channel ideal)"]
    assert len({agent.rank_group for agent in agents}) == 3


@pytest.mark.parametrize(
    ("facts", "name", "warning"),
    [
        ({"sensing": "perfect"}, "b (sensing perfect)", "sensing: realistic for a, c; perfect for b."),
        ({"friction": "weather"}, "b (friction weather)", "friction: dry for a, c; weather for b."),
        ({"ids": "scenario"}, "b (ids scenario)", "ids: random for a, c; scenario for b."),
        ({"agent_clock": "fixed:50"}, "b (agent clock fixed:50)", "agent clock: ideal for a, c; fixed:50 for b."),
        ({"seeds": (7,)}, "b (seed 7)", "seeds: 0 for a, c; 7 for b. Differences are paired by the seeds that both"),
        ({"channel": "paper-latency"}, "b (channel paper-latency)", "channel: ideal for a, c; paper-latency for b."),
    ],
)
def test_agents_under_other_conditions_are_named_warned_about_and_not_ranked(
    facts: dict[str, Any], name: str, warning: str
) -> None:
    """`b` would be first; without it `a` is."""
    half = dict.fromkeys(SINGLE, (50.0,))
    runs = [
        make_agent_run("a", SHARING, exchanged=("cam",)),
        make_agent_run("b", BEST, exchanged=("cam",), **facts),
        make_agent_run("c", half, exchanged=("cam",)),
    ]
    agents = make_agents_of_results(runs)
    assert agents[1].name == name
    said = list_warnings(agents)[0]
    assert said.startswith("The agents were driven under different conditions, so that places") and warning in said
    table = build_main_table(agents)
    assert [row.cells[-4].rank for row in table.rows] == [1, 0, 2]
    assert [cell.rank for cell in build_category_table(agents, "ds").rows[0].cells[2:]] == [1, 0, 2]
    text = format_report_markdown(build_comparison_report(agents))
    assert name in text and text.index("- **Note:** The agents were driven under") < text.index("## Scores")


def test_negotiation_is_more_than_cams_and_cpms() -> None:
    (agent,) = make_agents_of_results([make_agent_run("talker", BEST, exchanged=("mcm",))])
    assert agent.negotiates and not agent.shares_perception and agent.section == MULTI_AGENT


def test_library_code_names_a_line_only_if_nothing_else_does(tmp_path: Path) -> None:
    places: list[Path] = []
    for code in "ab":
        folder = save_run(tmp_path / code, make_agent_run("idm", BEST))
        header = {"format": FORMAT, "fingerprint": {"code": f"sha256:{code * 64}"}}
        (folder / "journal.jsonl").write_text(json.dumps(header) + "\n")
        rewrite_journal(folder / "journal.jsonl", str)
        places.append(folder)
    agents = make_compared_agents(load_report_runs(places))
    assert [agent.name for agent in agents] == ["idm (library code aaaaaaaaaaaa)", "idm (library code bbbbbbbbbbbb)"]


OTHER_VERSION = {"mdrive-sumo": "0.2.0", "libsumo": "1.28.0"}


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        (
            make_agent_run("a", BEST, suite="else", suite_checksum="sha256:2"),
            "expected runs of one suite, found made",
        ),
        (make_agent_run("a", BEST, suite_checksum="sha256:2"), "expected runs of one suite"),
        (make_agent_run("a", BEST, score_mode="interdrive_fixed"), "expected runs of one score mode, found mdrive in"),
        (make_agent_run("a", BEST, versions=OTHER_VERSION), "expected runs of one version, found mdrive-sumo 0.1.0"),
        (
            make_agent_run("a", {"i01": (100.0,)}),
            "found 6 in single and 1 in a; cone is only in single",
        ),
        (make_sample_runs()["single"], "same settings and seed once, found single with seed 0 in single and single"),
    ],
)
def test_runs_that_do_not_belong_together_are_refused(other: Results, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        make_agents_of_results([make_sample_runs()["single"], other])


def test_runs_of_two_seasons_are_refused() -> None:
    """Results that name no season are of season 0."""
    runs = [make_agent_run("a", BEST, suite="mdrive"), make_agent_run("b", BEST, suite="mdrive@1")]
    with pytest.raises(InputError, match=r"one season, found mdrive@0 in a and mdrive@1 in b; --mix-seasons puts"):
        make_agents_of_results(runs)


def make_season_run(agent: str, season: int, *, name: str = "") -> ReportRun:
    """A run of a season, whose scenarios are others than those of other seasons unless a name is given."""
    results = make_agent_run(
        agent, BEST, suite=f"mdrive@{season}" if season else "mdrive", suite_checksum=f"sha256:{season}"
    )
    ids = {one.id: f"{name or season}_{one.id}" for one in results.scenarios}
    scenarios = tuple(one.model_copy(update={"id": ids[one.id]}) for one in results.scenarios)
    return ReportRun.from_results(results.model_copy(update={"scenarios": scenarios}))


def test_runs_of_two_seasons_are_one_line_if_asked_for() -> None:
    runs = [make_season_run(agent, season) for season in (1, 0) for agent in ("a", "b")]
    merged = merge_seasons(runs)
    assert [run.results.run.suite for run in merged] == ["mdrive, seasons 0, 1"] * 2
    assert len({run.results.run.suite_checksum for run in merged}) == 1
    agents = make_compared_agents(merged)
    assert [agent.name for agent in agents] == ["a", "b"]
    assert len(agents[0].results.scenarios) == 2 * len(runs[0].results.scenarios)
    with pytest.raises(InputError, match=r"one suite, found mdrive, seasons 0, 1 .* and mdrive@0"):
        make_compared_agents(merge_seasons([*runs[:1], *runs[2:]]))
    with pytest.raises(InputError, match=r"scenarios of one season each, found same_.* in 2 seasons"):
        merge_seasons([make_season_run("a", 0, name="same"), make_season_run("a", 1, name="same")])


def test_runs_of_different_python_belong_together() -> None:
    other = {"mdrive-sumo": "0.1.0", "libsumo": "1.28.0", "python": "3.12.1"}
    assert name_all(make_agent_run("a", BEST), make_agent_run("b", BEST, versions=other)) == ["a", "b"]


def test_unusable_places_are_refused_in_one_sentence(tmp_path: Path) -> None:
    good, other = save_sample_runs(tmp_path)[:2]
    unknown = json.loads((other / "results.json").read_text()) | {"format": "mdrive-sumo/results/3"}
    (other / "results.json").write_text(json.dumps(unknown))
    begun = tmp_path / "begun"
    begun.mkdir()
    (begun / "journal.jsonl").write_text("")
    empty = json.loads((good / "results.json").read_text()) | {"scenarios": []}
    (tmp_path / "empty.json").write_text(json.dumps(empty))
    cases = {
        "expected every run once": [good, tmp_path / "x" / ".." / good.name],
        "format: expected 'mdrive-sumo/results/4', found 'mdrive-sumo/results/3'": [good, other],
        "expected a journal, found an empty file": [good, begun],
        "scenarios: expected at least one, found none": [good, tmp_path / "empty.json"],
        "expected a folder that": [tmp_path / "nothing"],
        "expected at least one run, found none": [],
    }
    for sentence, places in cases.items():
        with pytest.raises(InputError, match=sentence):
            load_report_runs(places)


def test_a_results_file_stands_for_its_run(tmp_path: Path) -> None:
    folder = save_sample_runs(tmp_path)[0]
    (run,) = load_report_runs([folder / "results.json"])
    assert run.place.endswith("results.json") and run.results.run.agent == "single"
