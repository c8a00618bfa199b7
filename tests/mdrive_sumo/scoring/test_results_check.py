"""What a results file cannot say is refused by whatever reads it: `compare`, `rescore`, `view`, a continued run."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from testing.score_golden import scenario
from testing.scored_pair import PAIR, ROADS, RUN, pair_episode

from mdrive_sumo.cli import main
from mdrive_sumo.scoring import ScoreMode, find_result_faults, make_void_result, score_episode, summarize_run
from mdrive_sumo.scoring.results import Results


def results(mode: ScoreMode = ScoreMode.MDRIVE) -> Results:
    reference = {ego.id: 100 for ego in PAIR.egos}
    found = score_episode(pair_episode(), PAIR, ROADS, mode, 1, reference)
    void = make_void_result(scenario(id="v"), 1, "SUMO stopped")
    return summarize_run(RUN.model_copy(update={"score_mode": str(mode)}), [found, void])


TREE = results().model_dump(mode="json")
ONE = TREE["scenarios"][0]["id"]


@pytest.mark.parametrize("mode", ScoreMode)
def test_real_results_have_no_fault(mode: ScoreMode) -> None:
    assert list(find_result_faults(results(mode))) == []


FOLLOWING = [
    *(("scenarios", 0, name) for name in ("ds", "sr", "rc", "ip", "seed")),
    *(("scenarios", 0, "egos", i, name) for i in (0, 1) for name in ("ds", "rc", "ip")),
    *(("scenarios", 1, name) for name in ("ds", "sr", "rc", "ip")),
    *(("overall", which, name) for which in ("bucket_mean", "scenario_mean") for name in ("ds", "sr", "rc", "ip")),
    *(("buckets", bucket, "ds") for bucket in TREE["buckets"]),
    *(("buckets", bucket, "scenarios") for bucket in TREE["buckets"]),
    ("overall", "timed"),
    ("void",),
]
"""Every figure that follows from others in the file."""


def changed(place: tuple[str | int, ...], value: Any) -> dict[str, Any]:
    tree = json.loads(json.dumps(TREE))
    part = tree
    for name in place[:-1]:
        part = part[name]
    part[place[-1]] = value(part[place[-1]]) if callable(value) else value
    return tree


@given(place=st.sampled_from(FOLLOWING), step=st.sampled_from((-3, -1, 1, 5, 1_000_000)))
def test_a_figure_changed_alone_is_found(place: tuple[str | int, ...], step: int) -> None:
    forged = Results.model_validate(changed(place, lambda value: value + step))
    assert any(str(place[-1]) in fault for fault in find_result_faults(forged))


BAD = {
    "too large": (("scenarios", 0, "ds"), 1e6, f"scenarios[{ONE}].ds: expected 0 to 100, found 1000000.0"),
    "negative": (("scenarios", 0, "ds"), -5.0, f"scenarios[{ONE}].ds: expected 0 to 100, found -5.0"),
    "not a number": (("scenarios", 0, "ds"), float("nan"), "scenarios.0.ds: expected a finite number"),
    "infinite": (("overall", "scenario_mean", "ds"), float("inf"), "expected a finite number"),
    "same id": (("scenarios", 1, "id"), ONE, f"scenarios: expected every id once, found '{ONE}' 2 times"),
    "no scenario": (("scenarios",), [], "scenarios: expected at least one, found none"),
    "another seed": (("scenarios", 0, "seed"), 7, f"scenarios[{ONE}].seed: expected the run's 1, found 7"),
    "score mode": (("run", "score_mode"), "best", "run.score_mode: expected one of mdrive, hard, interdrive_fixed"),
    "no CAVs": (("scenarios", 0, "egos"), [], f"scenarios[{ONE}].egos: expected at least one, found none"),
    "penalty": (("scenarios", 0, "egos", 0, "ip"), 2.0, ".ip: expected 0 to 1, found 2.0"),
    "forgiven": (("scenarios", 0, "egos", 0, "infractions"), [], ".ip: expected the product of its infractions'"),
    "factor": (("scenarios", 0, "egos", 0, "infractions", 0, "factor"), -1.0, ".factor: expected 0 to 1, found -1.0"),
    "messages": (("scenarios", 0, "notes"), {"hello": -1}, "notes.hello: expected a number of at least 0, found -1"),
    "load": (("scenarios", 0, "busy_ratio"), {"mean": 0.5, "greatest": 0.4}, ".busy_ratio: expected 0 <= mean <="),
    "ticks": (("scenarios", 0, "egos", 0, "ticks"), 10**9, ".ticks: expected at most the"),
    "void score": (("scenarios", 1, "ds"), 100.0, "scenarios[v].ds: expected 0.0, found 100.0"),
    "mean": (("overall", "bucket_mean", "ds"), 99.5, "overall.bucket_mean.ds: expected "),
}


@pytest.mark.parametrize("name", BAD)
def test_compare_refuses_it_in_one_sentence(tmp_path: Path, name: str) -> None:
    place, value, says = BAD[name]
    good, bad = tmp_path / "good.json", tmp_path / "bad.json"
    good.write_text(json.dumps(TREE))
    bad.write_text(json.dumps(changed(place, value)))
    for files in ((good, bad), (bad, good)):
        ended = CliRunner().invoke(main, ["compare", *map(str, files)])
        assert (ended.exit_code, ended.stdout, ended.stderr.count("\n")) == (2, "", 1), ended.output
        assert ended.stderr.startswith(f"Error: {bad}: ") and says in ended.stderr, ended.stderr
