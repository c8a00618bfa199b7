"""Paired comparison of two runs."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.compare import compare, comparison_table
from mdrive_sumo.runs.journal import open_journal
from mdrive_sumo.runs.setting_differences import find_setting_differences
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, summarize_run


def scenario(name: str, ds: float, sr: float = 0.0, status: str = "ok") -> ScenarioResult:
    return ScenarioResult.model_validate(
        {
            "id": name,
            "bucket": "InterDrive",
            "category": "ins_c",
            "seed": 0,
            "status": status,
            "reason": "",
            "ds": ds,
            "sr": sr,
            "rc": ds,
            "ip": 1.0,
            "min_ttc": None,
            "digest": "",
            "ticks": 1,
            "egos": [],
        }
    )


def run(*scenarios: ScenarioResult, **facts: object) -> Results:
    about = {
        "agent": "idm",
        "suite": "interdrive",
        "suite_checksum": "sha256:0",
        "seed": 0,
        "score_mode": "mdrive",
        "versions": {"libsumo": "1.28.0"},
    }
    return summarize_run(RunInfo.model_validate(about | facts), scenarios)


def test_differences_are_b_minus_a_and_sorted_by_loss() -> None:
    a = run(scenario("r1", 50.0), scenario("r2", 80.0, 50.0), scenario("r3", 100.0, 100.0))
    b = run(scenario("r3", 100.0, 100.0), scenario("r2", 60.0), scenario("r1", 100.0, 100.0), agent="omniscient")
    found = compare(a, b)
    assert [(p.scenario, p.ds_difference) for p in found.pairs] == [("r2", -20.0), ("r3", 0.0), ("r1", 50.0)]
    assert found.ds.mean == pytest.approx(10.0)
    assert found.sr.mean == pytest.approx(50 / 3)
    assert found.count_wins_ties_losses() == (1, 1, 1)
    assert found.warnings == ()


def test_times_are_compared_where_every_cav_arrives_in_both_runs() -> None:
    """Time ratio (1.5 - 3 + 1 - 2) / 2; efficient SR over three pairs (50 + 100 + 0) / 3."""

    def timed(name: str, efficient_sr: float | None, time_ratio: float | None) -> ScenarioResult:
        return scenario(name, 100.0).model_copy(update={"efficient_sr": efficient_sr, "time_ratio": time_ratio})

    a = run(timed("r1", 0.0, 3.0), timed("r2", 0.0, 2.0), timed("r3", 0.0, None), timed("r4", None, None))
    b = run(timed("r1", 50.0, 1.5), timed("r2", 100.0, 1.0), timed("r3", 0.0, 1.0), timed("r4", None, None))
    found = compare(a, b)
    assert found.time_ratio is not None and found.efficient_sr is not None
    assert (found.time_ratio.mean, found.timed, found.efficient_sr.mean) == (-1.25, 2, 50.0)
    lines = [line.split() for line in comparison_table(found).splitlines()]
    assert ["time", "ratio", "(of", "2)", "-1.25", "-", "-"] in lines
    assert "4 places: too few for an interval, which needs 10" in comparison_table(found)
    assert list(found.to_frame()["time_ratio_b"])[:3] == [1.5, 1.0, 1.0]


def test_no_difference_has_an_interval_of_no_width() -> None:
    same = run(*(scenario(f"r{i}", 50.0) for i in range(10)))
    found = compare(same, same)
    assert (found.ds.mean, found.ds.ends) == (0.0, (0.0, 0.0))
    assert "too few" not in comparison_table(found)


def test_one_scenario_has_no_interval() -> None:
    """It printed "-40.00 -40.00 -40.00"."""
    found = compare(run(scenario("r1", 90.0)), run(scenario("r1", 50.0)))
    lines = [line.split() for line in comparison_table(found).splitlines()]
    assert ["DS", "-40.00", "-", "-"] in lines
    assert "1 place: too few for an interval, which needs 10" in comparison_table(found)


def test_what_cannot_be_paired_is_listed() -> None:
    a = run(scenario("r1", 1.0), scenario("r2", 1.0), scenario("r3", 0.0, status="void"))
    b = run(scenario("r1", 1.0), scenario("r3", 90.0), scenario("r4", 1.0))
    found = compare(a, b)
    assert [p.scenario for p in found.pairs] == ["r1"]
    assert found.left_out == ("r2: only in A", "r4: only in B", "r3: void")
    assert "r4: only in B" in comparison_table(found)


@pytest.mark.parametrize("fact", [{"seed": 1}, {"suite_checksum": "sha256:1"}, {"versions": {"libsumo": "2"}}])
def test_different_circumstances_are_a_warning(fact: dict[str, object]) -> None:
    found = compare(run(scenario("r1", 1.0)), run(scenario("r1", 2.0), **fact))
    assert len(found.warnings) == 1
    assert found.warnings[0] in comparison_table(found)


def test_different_score_modes_are_refused() -> None:
    with pytest.raises(InputError, match="score mode, found mdrive and interdrive_fixed"):
        compare(run(scenario("r1", 1.0)), run(scenario("r1", 1.0), score_mode="interdrive_fixed"))


def test_runs_without_a_common_scenario_are_refused() -> None:
    with pytest.raises(InputError, match="in common"):
        compare(run(scenario("r1", 1.0)), run(scenario("r2", 1.0)))


def test_runs_of_two_seasons_are_compared_only_where_that_is_asked_for() -> None:
    """Results without a season are of season 0; suites without seasons go with all."""
    old, new = run(scenario("r1", 1.0)), run(scenario("r1", 2.0), suite="interdrive@1", suite_checksum="sha256:1")
    sentence = r"compare: .* one season, found interdrive@0 in A \(idm\) and interdrive@1 in B \(idm\); --mix-seasons"
    with pytest.raises(InputError, match=sentence):
        compare(old, new)
    with pytest.raises(InputError, match="found mdrive@secret-a in A"):
        compare(run(scenario("r1", 1.0), suite="mdrive@secret-a"), new)
    mixed = compare(old, new, mix_seasons=True)
    assert mixed.ds.mean == 1.0
    assert "A and B differ in suite: interdrive@0 and interdrive@1" in mixed.warnings
    assert "1 scenarios in both, of interdrive@0 (0) and interdrive@1 (1)" in comparison_table(mixed)
    assert compare(run(scenario("r1", 1.0), suite="mine"), new).ds.mean == 1.0


def test_table_shows_every_scenario_and_both_means() -> None:
    a, b = run(scenario("r1", 50.0)), run(scenario("r1", 75.5), agent="omniscient")
    table = comparison_table(compare(a, b))
    assert "A = idm, B = omniscient, 1 scenarios in both, of interdrive@0 (0)" in table
    assert "r1        ins_c     50.00  75.50  0.00  0.00       -       -    +25.50" in table
    lines = [line.split() for line in table.splitlines()]
    assert ["efficient", "SR", "-", "-", "-"] in lines and ["time", "ratio", "(of", "0)", "-", "-", "-"] in lines
    assert max(map(len, table.splitlines())) <= 100


def test_journals_name_options_and_code_of_the_agents(tmp_path: Path) -> None:
    """A results file has only a checksum of the options; without a journal the code is unknown, which is no change."""
    for name, speed, code in (("a", 3, "sha256:" + "1" * 64), ("b", 5, "sha256:" + "2" * 64)):
        facts = {"agent": "m.py:A", "agent_config": f'{{"speed":{speed}}}', "agent_code": code, "sandbox": False}
        with open_journal(tmp_path / name, facts, fresh=True):
            pass
    about = run(scenario("r1", 1.0)).run
    folders = (tmp_path / "a", tmp_path / "b")
    found = [(one.name, one.a, one.b) for one in find_setting_differences(about, about, folders)]
    assert found == [("agent code", "1" * 12, "2" * 12), ("agent config speed", "3", "5")]
    assert find_setting_differences(about, about, (None, None)) == ()
    lossy = about.model_copy(update={"comm": {"preset": "x", "loss": 0.1}})
    assert [str(one) for one in find_setting_differences(about, lossy)] == ["comm loss: - and 0.1"]
