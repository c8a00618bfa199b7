"""Model cards say what was measured; those of the repository are up to date."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest
from click.testing import CliRunner

from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_manifest import write_manifest
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.learning.fusion.detector_figures import FigureKey
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary, write_detectors_json
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, load_unchecked_results, save_results, summarize_run
from tools import write_model_card
from tools.model_card_text import format_card
from tools.write_model_card import (
    CARD_DETECTORS,
    NewMeasurements,
    build_card,
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


def test_a_card_has_the_rounds_of_dagger_and_their_data_sets() -> None:
    """Each training began with the weights of the one before; the last one is what is packaged."""
    first = {"steps": 4, "samples": 10, "sources": ["a"], "minutes": 1.0, "checkpoint": "out/1/weights.pt"}
    second = {"steps": 5, "samples": 20, "sources": ["a", "d1-tcp"], "minutes": 2.0, "begun_with": first}
    best = {"step": 6, "validation/ade_3s_m": 0.75}
    training = {**MANIFEST.training, "sources": ["a", "d1-tcp", "d2-tcp"], "begun_with": second, "best": best}
    card = format_card("tcp", {}, MANIFEST.model_copy(update={"training": training, "plan_head": "anchors"}))
    for text in (
        "| plan head | `anchors` |",
        "| data | 1000 samples: a, d1-tcp, d2-tcp |",
        "| weights of | step 6, with the least ADE over 3 s on validation: 0.750 m |",
        "| weights it began with | 5 steps on 20 samples: a, d1-tcp; 2.0 minutes |",
        "| weights it began with, 1 before | 4 steps on 10 samples: a; 1.0 minutes |",
    ):
        assert text in card


def test_measurements_of_earlier_weights_are_dropped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write_model_card, "FOLDER", tmp_path)
    old = {"open_loop": OPEN_LOOP, "closed_loop": {"as packaged": {}}, "notes": ["slow"]}
    (tmp_path / "tcp.json").write_text(json.dumps(old))
    (tmp_path / "same.json").write_text(json.dumps(OPEN_LOOP))
    (tmp_path / "other.json").write_text(json.dumps(OPEN_LOOP | {"sha256": "1" * 64}))
    assert update_measured("tcp", NewMeasurements(tmp_path / "same.json")) == old
    assert {*update_measured("tcp", NewMeasurements(tmp_path / "other.json"))} == {"open_loop"}


def save_detectors(folder: Path, training: Mapping[str, object]) -> None:
    """Manifests of all detectors, and in a folder of its own precisions of two."""
    for name in (*CARD_DETECTORS["detectors"], "codriving"):
        for part in (f"{name}-encoder", name):
            manifest = MANIFEST.model_copy(update={"system": part, "bytes": 500_000, "training": training})
            write_manifest(manifest, folder / f"{part}.json")
    key = FigureKey("clean", 0.5, "0 points")
    interval = ConfidenceInterval(0.125, 0.1, 0.15, 12)
    about = {name: {"data": {"frames": 100, "places": ["p"] * 12}, "training": training} for name in ("none", "late")}
    summary = DetectorSummary(about, {name: {key: interval} for name in about}, {}, {})
    (folder / "values").mkdir()
    (folder / "values" / "detectors-crowds.json").write_text(write_detectors_json(summary))


def test_a_card_of_detectors_says_how_each_was_trained_and_what_it_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, folder in (("FOLDER", "cards"), ("WEIGHTS_FOLDER", "."), ("VALUES_FOLDER", "values")):
        monkeypatch.setattr(write_model_card, name, tmp_path / folder)
    monkeypatch.setattr(write_model_card, "load_results", load_unchecked_results)
    training = {
        "frames": 24_000, "sources": ["/tmp/s/d/train", "d/crowds"], "steps": 5000, "is_gated": True, "device": "H100",
        "options": {"batch": 32, "seed": 0, "learning_rate": 6e-4}, "best": {"precision": 0.71, "step": 5000},
        "begun_with": {"checkpoint": "out/none/best.pt", "detector": "none"}, "torch": "2.11", "minutes": 4.5,
    }  # fmt: skip
    save_detectors(tmp_path, training)
    done = CliRunner().invoke(write_model_card.main, ["detectors", "--train", "learn train-detector", "--note", "late"])
    assert done.exit_code == 0, done.output
    card = (tmp_path / "cards" / "detectors.md").read_text()
    for text in (
        "# Model card: `none`, `early`, `attfuse`, `disconet`, `fcooper`, `cobevt`",
        "| `attfuse` | 1.00 | 2,469,134 | `0000000000000000` |",
        "| `attfuse` | 24000: d/train, d/crowds | 5000 of 32 frames | 0.0006 | 0 | yes | `none` | 0.710 |",
        "| H100, PyTorch 2.11 | 4.5 |",
        "learn train-detector",
        "## Precision, test, crowds",
        "| `late` |  |  |  |  |  |  | 12.5 [10.0, 15.0] |",
        "- late",
    ):
        assert text in card
    results = make_results(0, {"a": 50.0})
    results = results.model_copy(update={"run": results.run.model_copy(update={"agent": "codriving:fast"})})
    save_results(results, tmp_path / "results.json")
    done = CliRunner().invoke(write_model_card.main, ["codriving", "--run", f"without the cap={tmp_path}"])
    assert done.exit_code == 0, done.output
    card = (tmp_path / "cards" / "codriving.md").read_text()
    assert "| without the cap | interdrive | 0 | 50.00 |" in card and "## Precision" not in card
    for words, says in (
        (["detectors", "--run", f"x={tmp_path}"], "expected a run of detectors, found one of codriving:fast"),
        (["codriving", "--open-loop", str(tmp_path / "codriving.json")], "found codriving, which has none"),
        (["--note", "x"], "expected the NAME of a card with these options, found none"),
    ):
        done = CliRunner().invoke(write_model_card.main, words)
        assert done.exit_code == 2 and says in done.output
    write_manifest(MANIFEST.model_copy(update={"system": "none"}), tmp_path / "none.json")
    done = CliRunner().invoke(write_model_card.main, [])
    assert done.exit_code == 2 and "none: expected figures of the packaged weights" in done.output


def test_the_cards_of_the_repository_are_up_to_date() -> None:
    for system in list_cards():
        assert (write_model_card.FOLDER / f"{system}.md").read_text("utf-8") == build_card(
            system, load_measured(system)
        )
