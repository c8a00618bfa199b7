"""Model cards say what was measured; those of the repository are up to date."""

import json
from pathlib import Path

import pytest

from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, load_unchecked_results, save_results, summarize_run
from tools import write_model_card
from tools.write_model_card import (
    NewMeasurements,
    build_card,
    format_card,
    list_cards,
    load_measured,
    summarise_runs,
    update_measured,
)

MANIFEST = WeightsManifest(
    system="tcp",
    sha256="0" * 64,
    bytes=2_500_000,
    parameters=1_234_567,
    training={"samples": 1000, "sources": ["d"], "steps": 50, "options": {"batch": 8, "seed": 3}, "minutes": 4.25},
)
PLANS = {"ade_1s_m": 0.1, "fde_3s_m": 1.25}
OPEN_LOOP = {
    "system": "tcp", "sha256": "0" * 64, "samples": 7, "data": ["val"],
    "plan": PLANS, "constant_velocity": PLANS, "blackout": PLANS,
    "by_kind": {"brake": {"samples": 7, "ade_3s_m": 0.5}}, "decision_ms": {"median": 4.0, "p99": 9.0},
    "control_l1": {"throttle": 0.1, "brake": 0.2, "steer": 0.01},
}  # fmt: skip


def make_results(seed: int, scores: dict[str, float]) -> Results:
    rows = [
        ScenarioResult.model_validate(
            {
                "id": name, "bucket": "InterDrive", "category": "c", "seed": seed, "status": "ok", "reason": "",
                "ds": ds, "sr": 0.0, "rc": ds, "ip": 1.0, "min_ttc": None, "digest": "", "ticks": 1, "egos": (),
            }
        )
        for name, ds in scores.items()
    ]  # fmt: skip
    about = {
        "agent": "tcp", "suite": "interdrive", "suite_checksum": "sha256:0", "seed": seed, "score_mode": "mdrive",
        "versions": {}, "command": (),
    }  # fmt: skip
    return summarize_run(RunInfo.model_validate(about), rows)


def test_a_condition_is_the_mean_over_its_seeds_with_an_interval() -> None:
    better = {f"b{place}": 100.0 for place in range(9)}
    found = summarise_runs([make_results(0, {"a": 50.0, **better}), make_results(1, {"a": 60.0, **better})])
    assert (found["ds"], found["seeds"], found["episodes"], found["worst"][0]) == (95.5, [0, 1], 20, "a")
    assert found["ds_interval"][0] < 95.5 < found["ds_interval"][1]


def test_runs_that_do_not_belong_together_are_refused() -> None:
    first = make_results(0, {"a": 50.0, "b": 100.0})
    with pytest.raises(InputError, match="agent tcp: expected runs of the same scenarios, found others"):
        summarise_runs([first, make_results(1, {"a": 60.0})])
    with pytest.raises(InputError, match=r"agent tcp: expected one run a seed, found the seeds \[0, 0\]"):
        summarise_runs([first, first])
    other = first.model_copy(update={"run": first.run.model_copy(update={"seed": 1, "agent": "idm"})})
    with pytest.raises(InputError, match="expected runs with one agent, found tcp and idm"):
        summarise_runs([first, other])
    with pytest.raises(InputError, match="expected a score of every scenario, found 2 without"):
        summarise_runs([first.model_copy(update={"void": 2})])


def test_measurements_of_another_system_or_other_weights_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write_model_card, "FOLDER", tmp_path)
    monkeypatch.setattr(write_model_card, "load_results", load_unchecked_results)
    save_results(make_results(0, {"a": 50.0}), tmp_path / "results.json")
    (tmp_path / "open.json").write_text(json.dumps(OPEN_LOOP))
    for new, message in (
        (NewMeasurements(open_loop=tmp_path / "open.json"), "expected a measurement of vad, found one of tcp"),
        (NewMeasurements(runs=[f"as packaged={tmp_path}"]), "expected a run of vad, found one of tcp"),
        (NewMeasurements(runs=[str(tmp_path)]), "--run: expected CONDITION=RUN, found '/"),
    ):
        with pytest.raises(InputError, match=message):
            update_measured("vad", new)
    with pytest.raises(
        InputError, match=r"tcp: expected measurements of the packaged weights \w+\.\.\., found those of 000"
    ):
        build_card("tcp", {"open_loop": OPEN_LOOP})


def test_a_card_says_what_was_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write_model_card, "FOLDER", tmp_path)
    monkeypatch.setattr(write_model_card, "load_results", load_unchecked_results)  # scenarios without CAVs
    save_results(make_results(0, {"a": 50.0, "b": 100.0}), tmp_path / "results.json")
    (tmp_path / "open.json").write_text(json.dumps(OPEN_LOOP))
    new = NewMeasurements(tmp_path / "open.json", [f"as packaged={tmp_path}"], ["learn train tcp"], ["slow"])
    measured = update_measured("tcp", new)
    card = format_card("tcp", measured, MANIFEST)
    for text in (
        "Counterpart of TCP, trained on mdrive-sumo data",
        "| parameters | 1,234,567 |",
        "| steps | 50 of 8 samples, seed 3 |",
        "| time | 4.2 minutes |",
        "learn train tcp",
        "| plans of | ADE 1s [m] | FDE 3s [m] |",
        "brake 0.50 m (7)",
        "| as packaged | interdrive | 0 | 75.00 |",
        "lowest DS: a, b.",
        "- slow",
    ):
        assert text in card
    assert measured["closed_loop"]["as packaged"]["ds"] == 75.0


def test_the_cards_of_the_repository_are_up_to_date() -> None:
    for system in list_cards():
        assert (write_model_card.FOLDER / f"{system}.md").read_text("utf-8") == build_card(
            system, load_measured(system)
        )
