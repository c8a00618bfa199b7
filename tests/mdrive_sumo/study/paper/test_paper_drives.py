"""`study paper` with real drives: two short scenarios, two agents."""

import json
from pathlib import Path

import pytest
from testing.short_suite import make_short_suite
from testing.study_samples import invoke

from mdrive_sumo.scoring import load_results


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_two_short_scenarios_from_the_command_to_the_tables(tmp_path: Path) -> None:
    suite = make_short_suite(tmp_path / "suite", "i01*", "i11*", metres=40)
    out = tmp_path / "out"
    ended = invoke(
        "study", "paper", "--suite", suite, "--agents", "constant-speed,sharing", "--out", out, "--workers", "1"
    )
    assert ended.exit_code == 0, ended.output
    page = json.loads((out / "paper.json").read_text())
    assert page["closed"]["sharing"]["role"] == "multi-agent"
    assert [row["condition"] for row in page["channel"]] == ["base", "latency 6 ticks", "pose-error 0.6 m 0.6°"]
    assert page["open"]["sharing"]["frames"] > 0 and page["open"]["sharing"]["ap50"] is not None
    assert page["open_closed"]["scenarios"] == 2
    clean, late = (
        load_results(out / "runs" / place / "results.json")
        for place in ("closed/sharing", "channel/sharing/latency_6_ticks")
    )
    assert {one.digest for one in clean.scenarios}.isdisjoint(one.digest for one in late.scenarios), "latency counts"
    assert (out / "figures" / "open_closed_figure.svg").stat().st_size > 1000
