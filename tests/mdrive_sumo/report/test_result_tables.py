"""Tables for the terminal and the Markdown report."""

from itertools import pairwise
from typing import Any

import pytest

from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.report.result_tables import (
    count_collisions_by_severity,
    count_infractions,
    count_outcomes,
    format_summary,
)
from mdrive_sumo.report.run_report import build_run_report
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, summarize_run
from mdrive_sumo.scoring.results import BusyRatioSummary, SentRate


def ego(name: str, outcome: str, reason: str = "", *infractions: tuple[str, float]) -> dict[str, Any]:
    marks = [{"kind": kind, "tick": 9, "x": 0, "y": 0, "factor": factor, "other": ""} for kind, factor in infractions]
    return {"id": name, "outcome": outcome, "reason": reason, "ds": 0, "rc": 0, "ip": 1, "infractions": marks}


def scenario(name: str, bucket: str, category: str, ds: float, *egos: dict[str, Any]) -> ScenarioResult:
    facts = {"id": name, "bucket": bucket, "category": category, "seed": 0, "status": "ok", "reason": ""}
    scores = {"ds": ds, "sr": ds, "rc": ds, "ip": 0.5, "min_ttc": 0.81, "digest": "ab", "ticks": 600}
    scores |= {"efficient_sr": ds / 2, "time_ratio": 1.5} if ds == 100.0 else {}
    return ScenarioResult.model_validate(facts | scores | {"egos": egos})


@pytest.fixture
def results() -> Results:
    info = RunInfo(
        agent="omniscient",
        labels=("privileged", "unsandboxed"),
        suite="demo",
        suite_checksum="sha256:00",
        seed=7,
        score_mode="mdrive",
        versions={"libsumo": "1.28.0", "mdrive-sumo": "0.1.0"},
        command=("mdrive-sumo", "eval", "--scenario", "r*"),
    )
    void = scenario("r3", "V2XPnP", "log", 0.0).model_copy(update={"status": "void", "reason": "a <b> | worker\ndied"})
    clean, hit = ego("0", "arrived"), ego("1", "arrived", "", ("collision-vehicle", 0.6), ("blocked", 1.0))
    return summarize_run(
        info,
        (
            scenario("r1", "InterDrive", "ins_c", 100.0, clean, hit),
            scenario("r2", "InterDrive", "ins_sl", 50.0, ego("0", "agent-failed", "crashed")),
            void,
        ),
    )


def test_malformed_messages_have_a_line_only_if_there_are_any(results: Results) -> None:
    assert "malformed" not in format_summary(results)
    problems = {"cam: expected at least 18 bytes": 150, "text: too long": 50}
    marked = [one.model_copy(update={"malformed": problems}) for one in results.scenarios[:1]]
    said = format_summary(summarize_run(results.run, [*marked, *results.scenarios[1:]])).splitlines()
    line = "200 messages, dropped: cam: expected at least 18 bytes (150); text: too long (50)"
    assert f"malformed    {line}" in said


def test_results_without_malformed_messages_are_written_as_before(results: Results) -> None:
    assert all("malformed" not in one.model_dump(mode="json") for one in results.scenarios)


def test_rates_are_means_over_time_and_have_a_line_only_where_they_vary(results: Results) -> None:
    assert "messages" not in format_summary(results) and "## Messages" not in build_run_report(results)
    rates = [{"cam": SentRate(messages_s=10.0, bytes_s=300.0)}, {"cam": SentRate(messages_s=4.0, bytes_s=120.0)}]
    rates[1]["denm"] = SentRate(messages_s=1.0, bytes_s=39.0)
    sent = [
        one.model_copy(update={"sent_rates": rate, "ticks": ticks})
        for one, rate, ticks in zip(results.scenarios, rates, (200, 100), strict=False)
    ]
    changed = summarize_run(results.run, [*sent, results.scenarios[2]])
    assert "messages     cam 8.0/s 240 B/s, denm 0.3/s 13 B/s" in format_summary(changed).splitlines()
    assert "| cam | 8.00 | 240 |" in build_run_report(changed)


def test_the_load_of_a_radio_is_a_mean_over_time_and_a_maximum(results: Results) -> None:
    assert "busy ratio" not in format_summary(results) + build_run_report(results)
    loads = [BusyRatioSummary(mean=0.1, greatest=0.2), BusyRatioSummary(mean=0.4, greatest=0.5), None]
    measured = [
        one.model_copy(update={"busy_ratio": load, "ticks": ticks})
        for one, load, ticks in zip(results.scenarios, loads, (200, 100, 300), strict=True)
    ]
    changed = summarize_run(results.run, measured)
    assert "busy ratio   mean 0.200, greatest 0.500" in format_summary(changed).splitlines()
    report = build_run_report(changed)
    assert "## Messages\n\n- channel busy ratio at the CAVs: mean 0.200, greatest 0.500\n" in report


def test_text_table_aligns_names_left_and_numbers_right() -> None:
    assert format_text(make_text_table(("name", "n"), (("a", "1"), ("longer", "10")))).splitlines() == [
        "name     n",
        "----------",
        "a        1",
        "longer  10",
    ]


def test_a_table_without_rows_is_a_header() -> None:
    assert format_text(make_text_table(("name", "n"), ())) == "name  n\n-------"


def test_summary_has_buckets_and_both_means(results: Results) -> None:
    """InterDrive (100 + 50) / 2 = 75, V2XPnP 0: bucket mean 37.5, scenario mean 150 / 3 = 50."""
    lines = [line.split() for line in format_summary(results).splitlines()]
    assert ["InterDrive", "2", "75.00", "75.00", "50.00", "1.50", "75.00", "0.500", "1"] in lines
    assert ["V2XPnP", "1", "0.00", "0.00", "-", "-", "0.00", "0.500", "0"] in lines
    assert ["bucket", "mean", "2", "37.50", "37.50", "50.00", "1.50", "37.50", "0.500", "1"] in lines
    assert ["scenario", "mean", "3", "50.00", "50.00", "50.00", "1.50", "50.00", "0.500", "1"] in lines


def test_scenarios_without_reference_times_are_counted_with_the_remedy(results: Results) -> None:
    remedy = "none for 2 scenarios: `mdrive-sumo validate SUITE --write`, `mdrive-sumo rescore RUN`"
    assert f"times        {remedy}" in format_summary(results).splitlines()
    assert remedy in build_run_report(results)
    timed = summarize_run(results.run, results.scenarios[:1])
    assert "times  " not in format_summary(timed)
    assert "Reference times" not in build_run_report(timed)


def test_summary_names_agent_labels_outcomes_infractions_and_voids(results: Results) -> None:
    text = format_summary(results)
    assert "suite demo (00), agent omniscient [privileged, unsandboxed], seed 7, score mode mdrive" in text
    assert "outcomes     arrived 2, agent-failed (crashed) 1" in text
    assert "infractions  collision-vehicle 1\n" in text
    assert "void         1" in text
    assert "  r3: a <b> | worker died" in text.splitlines()
    assert max(map(len, text.splitlines())) <= 100


def test_marks_without_a_cost_are_no_infractions(results: Results) -> None:
    assert count_infractions(results) == {"collision-vehicle": 1}
    assert sum(count_outcomes(results).values()) == 3


def test_collisions_are_counted_by_impact_speed(results: Results) -> None:
    """0 and 0.99 m/s are slow, 1 and 5 in between, 5.01 fast; red lights have no severity."""
    assert count_collisions_by_severity(results) == {"below 1 m/s": 0, "1 to 5 m/s": 0, "above 5 m/s": 0, "unknown": 1}
    hits = ego("0", "arrived", "", *(("collision-static", 0.65),) * 5, ("red-light", 0.7))
    for mark, speed in zip(hits["infractions"], (0.0, 0.99, 1.0, 5.0, 5.01), strict=False):
        mark["impact_speed"] = speed
    found = summarize_run(results.run, (scenario("r1", "InterDrive", "ins_c", 10.0, hits),))
    assert "severity     below 1 m/s 2, 1 to 5 m/s 2, above 5 m/s 1\n" in format_summary(found)
    assert "| above 5 m/s | 1 |" in build_run_report(found)
    clean = summarize_run(results.run, (scenario("r1", "InterDrive", "ins_c", 10.0),))
    assert "severity     none" in format_summary(clean) and "No collisions." in build_run_report(clean)


def test_report_has_every_scenario_and_category(results: Results) -> None:
    report = build_run_report(results)
    assert (
        "| r1 | ins_c | 100.00 | 100.00 | 50.00 | 1.50 | 100.00 | 0.500 | 0.81 | - | - | - | - | - | 600 | 0 arrived, "
        "1 arrived |" in report
    )
    assert "| ins_sl | 1 | 50.00 | 50.00 | - | - | 50.00 | 0.500 | 0 | 50.00 |" in report
    assert "| LM | 1 | 100.00 | 100.00 | 50.00 | 1.50 | 100.00 | 0.500 | 1 | 100.00 |" in report
    assert "`mdrive-sumo eval --scenario 'r*'`" in report
    assert "libsumo 1.28.0, mdrive-sumo 0.1.0" in report


def test_report_cannot_be_broken_by_texts_from_files(results: Results) -> None:
    report = build_run_report(results)
    assert "- void: r3: a &lt;b> \\| worker died" in report
    tables = [line for line in report.splitlines() if line.startswith("|")]
    assert all(line.endswith(" |") for line in tables)


def test_every_row_of_a_report_table_has_as_many_cells_as_its_header(results: Results) -> None:
    lines = build_run_report(results).splitlines()
    for above, below in pairwise(lines):
        if above.startswith("|") and below.startswith("|"):
            assert above.replace("\\|", "").count("|") == below.replace("\\|", "").count("|")
