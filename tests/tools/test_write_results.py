"""The tables of measured scores: means over seeds, rows of runs that do not belong together, undefined numbers."""

import json
from pathlib import Path

import pytest

from mdrive_sumo.agents.learned.model_weights import WEIGHTS_FOLDER
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, load_unchecked_results, save_results, summarize_run
from tools import write_results
from tools.write_results import BUCKETS, SWAPS, build_row, build_rows, format_baselines, format_times


def scenario(bucket: str, seed: int, ds: float, time_ratio: float | None, efficient_sr: float | None) -> ScenarioResult:
    facts = {"id": f"of-{bucket}", "bucket": bucket, "category": "c", "seed": seed, "status": "ok", "reason": ""}
    scores = {"ds": ds, "sr": ds, "rc": ds, "ip": 1.0, "efficient_sr": efficient_sr, "time_ratio": time_ratio}
    return ScenarioResult.model_validate(facts | scores | {"min_ttc": None, "digest": "", "ticks": 1, "egos": ()})


def run(
    seed: int, ds: float = 100.0, time_ratio: float | None = 1.5, efficient_sr: float | None = 50.0, **facts: object
) -> Results:
    about = {
        "agent": "idm",
        "suite": "mdrive",
        "suite_checksum": "sha256:0",
        "seed": seed,
        "score_mode": "mdrive",
        "versions": {"libsumo": "1.28.0"},
        "command": ("mdrive-sumo", "eval", "--seed", str(seed)),
        "comm": {"preset": "ideal"},
        "ids": "random",
        "sensing": "realistic",
    }
    rows = [scenario(bucket, seed, ds, time_ratio, efficient_sr) for bucket in BUCKETS]
    return summarize_run(RunInfo.model_validate(about | facts), rows)


def test_a_row_is_the_mean_over_the_seeds() -> None:
    """DS (100 + 90 + 80) / 3; the time ratio over the two seeds that have one, (1.5 + 3) / 2."""
    runs = [run(2, 100.0, 1.5), run(0, 90.0, None, 20.0), run(1, 80.0, 3.0)]
    row = build_row(runs)
    assert row["scores"]["overall"] == {"ds": 90.0, "sr": 90.0, "efficient_sr": 40.0, "time_ratio": 2.25}
    assert row["scores"]["V2XPnP"] == row["scores"]["overall"]
    assert (row["seeds"], row["scenarios"], row["episodes"], row["timed"]) == ([0, 1, 2], 3, 9, 6)


def test_the_tables_show_undefined_numbers_as_a_dash() -> None:
    rows = build_rows([run(0), run(0, time_ratio=None, efficient_sr=None, agent="take-turns")], "abc")
    table = format_baselines(rows, ("take-turns", "idm", "single")).splitlines()
    assert table[0].endswith("| Overall | Efficient SR | Time ratio |")
    assert table[2].startswith("| `take-turns` |") and table[2].endswith("| 100.00 / 100.00 | - | - |")
    assert table[3].startswith("| `idm` |") and table[3].endswith("| 100.00 / 100.00 | 50.00 | 1.50 |")
    assert len(table) == 4
    times = format_times(rows, ("take-turns", "idm")).splitlines()
    assert times[2] == "| `take-turns` | - / - | - / - | - / - | - / - | 0 of 3 | 0 | abc |"
    assert times[3] == f"| `idm` | {'50.00 / 1.50 | ' * 4}3 of 3 | 0 | abc |"


def test_a_row_of_fewer_seeds_says_which() -> None:
    rows = build_rows(
        [run(0), *(run(seed, agent="single") for seed in (0, 1, 2)), run(0, agent="vad"), run(2, agent="vad")],
        "abc",
    )
    cells = [line.split(" | ")[1] for line in format_baselines(rows, ("idm", "single", "vad")).splitlines()[2:]]
    assert [cell.endswith("only)") for cell in cells] == [True, False, True]
    assert "(seed 0 only)" in cells[0] and "(seeds 0, 2 only)" in cells[2]


def test_a_row_of_a_family_has_the_least_and_the_greatest_of_its_members() -> None:
    """Of seven detectors two are driven, one of them with one seed; the surrogates' profiles are no members."""
    rows = build_rows(
        [
            *(run(seed, 60.0, agent="perception-swap:none") for seed in (0, 1, 2)),
            run(0, 70.5, None, 40.0, agent="perception-swap:attfuse"),
            run(0, 99.0, agent="perception-swap:attfuse:profile"),
        ],
        "abc",
    )
    *_, line = format_baselines(rows, (SWAPS,)).splitlines()
    assert line.startswith("| `perception-swap:*` | ") and "(seed 0 only) | 60.00 to 70.50 / 60.00 to 70.50 |" in line
    assert line.endswith("| 40.00 to 50.00 | 1.50 |")
    assert len(format_baselines({}, (SWAPS,)).splitlines()) == 2


@pytest.mark.parametrize(
    ("second", "says"),
    [
        (run(0), r"expected one run a seed, found the seeds \[0, 0\]"),
        (run(1, suite_checksum="sha256:1"), "expected runs with one suite_checksum, found sha256:0 and sha256:1"),
        (run(1, versions={"libsumo": "2"}), "expected runs with one versions"),
        (run(1, comm={"preset": "its-g5"}), "expected runs with one comm"),
        (run(1, agent_config="sha256:2"), "expected runs with one agent_config"),
        (run(1).model_copy(update={"scenarios": run(1).scenarios[:2]}), "expected runs of the same scenarios"),
    ],
)
def test_runs_that_differ_in_more_than_the_seed_are_refused(second: Results, says: str) -> None:
    with pytest.raises(InputError, match=f"agent idm: {says}"):
        build_rows([run(0), second], "abc")


@pytest.mark.parametrize(
    ("facts", "says"),
    [
        ({"comm": {"preset": "realistic"}}, "channel: expected ideal, found realistic"),
        ({"sensing": "perfect"}, "sensing: expected realistic, found perfect"),
        ({"ids": "scenario"}, "ids: expected random, found scenario"),
        ({"others": "single"}, "others: expected none, found single"),
    ],
)
def test_runs_under_other_conditions_than_the_table_are_refused(facts: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=f"agent idm: {says}"):
        build_rows([run(0, **facts), run(1, **facts)], "abc")


def test_a_row_is_of_an_agent_as_packaged(tmp_path: Path) -> None:
    """A host may name the packaged weights by their path there; the hash of options is over their bytes."""
    copied = tmp_path / "tcp.onnx"
    copied.write_bytes((WEIGHTS_FOLDER / "tcp.onnx").read_bytes())
    named = AgentSpec("tcp", {"weights": str(copied), "provider": "cpu"}).config_hash()
    assert build_rows([run(0, agent="tcp", agent_config=named)], "abc")["tcp"]["seeds"] == [0]
    copied.write_bytes(b"others")
    others = AgentSpec("tcp", {"weights": str(copied), "provider": "cpu"}).config_hash()
    for agent, options in (("tcp", others), ("idm", named), ("perception-swap:late", named)):
        with pytest.raises(InputError, match=f"agent {agent}: expected it as packaged, found a run with options"):
            build_rows([run(0, agent=agent, agent_config=options)], "abc")


def test_a_run_of_one_bucket_is_refused() -> None:
    part = summarize_run(run(0).run, run(0).scenarios[:1])
    with pytest.raises(InputError, match="expected a run of --suite mdrive@0, found none of bucket Interaction"):
        build_rows([part], "abc")


def test_the_command_replaces_the_row_and_both_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pages = (write_results.README, write_results.RESULTS_PAGE, write_results.SPEED_PAGE)
    for page in (*pages, write_results.BASELINES, write_results.SPEED):
        (tmp_path / page).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / page).write_text((write_results.ROOT / page).read_text("utf-8"), "utf-8")
    for seed in (0, 1, 2):
        (tmp_path / f"run{seed}").mkdir()
        save_results(run(seed, 90.0 + seed, agent="take-turns"), tmp_path / f"run{seed}" / "results.json")
    monkeypatch.setattr(write_results, "ROOT", tmp_path)
    monkeypatch.setattr(write_results, "load_results", load_unchecked_results)  # the scores are made up
    runs = [str(tmp_path / f"run{seed}") for seed in (0, 1, 2)]
    write_results.main([*runs, "--commit", "abc"], standalone_mode=False)
    row = json.loads((tmp_path / write_results.BASELINES).read_text())["take-turns"]
    assert (row["seeds"], row["scores"]["overall"]["ds"]) == ([0, 1, 2], 91.0)
    for page in (write_results.README, write_results.RESULTS_PAGE):
        assert "| 91.00 / 91.00 | 50.00 | 1.50 |" in (tmp_path / page).read_text("utf-8")
    assert "| 9 of 9 | 0, 1, 2 | abc |" in (tmp_path / write_results.RESULTS_PAGE).read_text("utf-8")
