"""Captured cooperation: per bucket, category and seed, void scenarios, and in every table."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.study_samples import make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.result_tables import format_summary
from mdrive_sumo.report.run_report import build_run_report
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.scoring.captured_cooperation import (
    LEAST_GAIN_DS,
    compute_captured_cooperation,
    compute_captured_from_scenarios,
    compute_captured_share,
)


def test_captured_per_bucket_category_and_overall() -> None:
    agent = make_run(make_scenario("a", 60), make_scenario("b", 90, bucket="Real", category="r"))
    off = make_run(make_scenario("a", 40), make_scenario("b", 90, bucket="Real", category="r"))
    best = make_run(make_scenario("a", 80), make_scenario("b", 91, bucket="Real", category="r"))
    found = compute_captured_cooperation(agent, off, best)
    assert found.buckets == {"InterDrive": 0.5, "Real": None}
    assert found.categories == {"ins_c": 0.5, "r": None, "LM": 0.5}
    assert found.bucket_mean == found.scenario_mean == pytest.approx(20 / 41)


def test_captured_leaves_out_what_is_void_in_one_of_the_runs() -> None:
    agent = make_run(make_scenario("a", 60), make_scenario("b", 0, status="void"), make_scenario("c", 100))
    off = make_run(make_scenario("a", 40), make_scenario("b", 100), make_scenario("c", 100))
    best = make_run(make_scenario("a", 80), make_scenario("b", 100), make_scenario("c", 0, status="void"))
    assert compute_captured_cooperation(agent, off, best).scenario_mean == 0.5
    with pytest.raises(InputError, match="expected scenarios that all three runs have"):
        compute_captured_cooperation(agent, off, make_run(make_scenario("z", 1)))


@pytest.mark.parametrize("fact", [{"score_mode": "interdrive_fixed"}, {"suite_checksum": "sha256:1"}])
def test_runs_that_do_not_belong_together_are_refused(fact: dict[str, str]) -> None:
    one = make_run(make_scenario("a", 60))
    with pytest.raises(InputError, match="expected runs of one"):
        compute_captured_cooperation(one, one, make_run(make_scenario("a", 80), **fact))


@given(off=st.floats(0, 98), gain=st.floats(LEAST_GAIN_DS, 100), part=st.floats(-1, 2))
def test_the_share_is_what_was_put_in(off: float, gain: float, part: float) -> None:
    found = compute_captured_share(off + part * gain, off, off + gain)
    assert found is None or found == pytest.approx(part, abs=1e-9)
    assert compute_captured_share(off, off, off + LEAST_GAIN_DS * 0.99) is None
    assert compute_captured_share(100, off, off - gain) is None


def test_seeds_are_paired_by_seed() -> None:
    agent = [make_scenario("a", 50, 0), make_scenario("a", 70, 1)]
    off = [make_scenario("a", 40, 0), make_scenario("a", 40, 1), make_scenario("a", 0, 2)]
    best = [make_scenario("a", 80, 0), make_scenario("a", 80, 1)]
    assert compute_captured_from_scenarios(agent, off, best, ScoreMode.MDRIVE).scenario_mean == 0.5


def test_every_table_shows_captured_cooperation_if_it_is_there() -> None:
    agent = make_run(make_scenario("a", 60), make_scenario("b", 90, bucket="Real", category="r"))
    off, best = (
        make_run(make_scenario("a", ds), make_scenario("b", 90, bucket="Real", category="r")) for ds in (40, 80)
    )
    shares = compute_captured_cooperation(agent, off, best)
    table = format_summary(agent, shares).splitlines()
    assert table[2].endswith("captured [%]")
    assert table[4].split()[-1] == "50.0" and table[5].split()[-2:] == ["1.000", "0"]
    page = build_run_report(agent, shares)
    assert "Captured cooperation is (agent" in page
    assert "| InterDrive | 1 | 60.00 | 60.00 | - | - | 60.00 | 1.000 | 0 | 50.0 |" in page
    assert "| ins_c | 1 | 60.00 | 60.00 | - | - | 60.00 | 1.000 | 0 | 60.00 | 50.0 |" in page
    assert "aptured" not in format_summary(agent) + build_run_report(agent)
