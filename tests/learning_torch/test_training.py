"""Training: losses fall, an interrupted run goes on as if nothing had happened, bad input ends in one sentence."""

import json
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.sample_format import SCENARIOS_PER_PLACE
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training import trainer as training
from mdrive_sumo.learning.training import training_data
from mdrive_sumo.learning.training.checkpoint import (
    CHECKPOINT_NAME,
    WEIGHTS_NAME,
    load_checkpoint,
    load_whole_checkpoint,
)
from mdrive_sumo.learning.training.run_training import TrainingRun, run_training
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.learning.training.training_data import TrainingData
from mdrive_sumo.learning.training.training_options import TrainingOptions

CPU = torch.device("cpu")
OPTIONS = TrainingOptions(steps=6, batch=2, log_every=2)


def make_trainer(system: str = "tcp", options: TrainingOptions = OPTIONS) -> tuple[Trainer, TrainingData]:
    arrays = build_synthetic_arrays(SYSTEMS[system], 4, seed=0)
    return Trainer(system, options, CPU), TrainingData(SYSTEMS[system], arrays, CPU)


@pytest.mark.usefixtures("drawn_curves")
def test_the_smoke_test_lowers_the_loss(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["learn", "train", "tcp", "--smoke", "--device", "cpu", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert "mean loss of the first 10 of 50 steps" in result.output
    assert (tmp_path / "smoke" / "curves.png").is_file()


@pytest.mark.parametrize("system", ["vad", "uniad", "lmdrive"])
def test_every_system_takes_steps(system: str, tmp_path: Path) -> None:
    trainer, data = make_trainer(system, replace(OPTIONS, steps=2, log_every=1))
    losses = trainer.train(data, np.ones(4), tmp_path)
    assert losses["total"] > 0 and {"plan", "occupancy", "agents"} <= set(losses)


@pytest.mark.parametrize(("system", "plan_head"), [("tcp", "anchors"), ("uniad", "anchors"), ("vad", "waypoints")])
def test_half_precision_has_nearly_the_same_losses_and_the_same_gradients(system: str, plan_head: str) -> None:
    losses: list[dict[str, float]] = []
    trained: list[set[str]] = []
    for uses_bfloat16 in (False, True):
        trainer, data = make_trainer(system, TrainingOptions(batch=2, plan_head=plan_head))
        trainer.uses_bfloat16 = uses_bfloat16
        parts = trainer._take_step(data, torch.ones(4, dtype=torch.float64), 0.0)
        losses.append({name: float(part.detach()) for name, part in parts.items()})
        named = {name: value.grad for name, value in trainer.network.named_parameters() if value.grad is not None}
        assert all(bool(grad.isfinite().all()) for grad in named.values())
        trained.append({name for name, grad in named.items() if bool(grad.any())})
    assert losses[1] == pytest.approx(losses[0], rel=0.1, abs=0.05) and losses[1] != losses[0]
    assert trained[1] == trained[0]


def test_data_leaves_a_gpu_that_another_process_has_filled_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    here = {"own": torch.ones(2)}
    looks = iter((True, False))

    def fits(*_: object) -> bool:
        return next(looks)

    def stay(each: torch.Tensor, _: object) -> torch.Tensor:
        return each

    monkeypatch.setattr(training_data, "_fits", fits)
    monkeypatch.setattr(torch.cuda, "empty_cache", lambda: None)
    monkeypatch.setattr(torch.Tensor, "to", stay)
    place, tensors = training_data._place(here, 8, torch.device("cuda"))
    assert place == CPU and tensors is here


def test_a_resumed_run_ends_as_an_uninterrupted_one(tmp_path: Path) -> None:
    whole, data = make_trainer()
    whole.train(data, np.ones(4), tmp_path / "whole")
    first, _ = make_trainer(options=replace(OPTIONS, steps=3))
    first.options = replace(OPTIONS, max_minutes=None)
    for _ in range(3):
        first._take_step(data, torch.ones(4, dtype=torch.float64), first.options.find_progress(first.step, 0.0))
        first.step += 1
    first.save(tmp_path / "parts")
    second, _ = make_trainer()
    second.resume(load_checkpoint(tmp_path / "parts", "tcp"))
    second.train(data, np.ones(4), tmp_path / "parts")
    for name, expected in whole.average.network.state_dict().items():
        assert torch.equal(second.average.network.state_dict()[name], expected), name
    assert [row[0] for row in read_curves(tmp_path / "parts" / "curves.csv")][-1] == 6


def test_training_ends_itself_in_time(tmp_path: Path) -> None:
    trainer, data = make_trainer(options=TrainingOptions(steps=10_000, batch=2, max_minutes=0.02))
    trainer.train(data, np.ones(4), tmp_path)
    assert 0 < trainer.step < 1000
    assert load_checkpoint(tmp_path, "tcp").step == trainer.step
    assert trainer.optimizer.param_groups[0]["lr"] < 0.5 * trainer.options.learning_rate


def test_a_run_validates_on_drives_that_it_has_not_seen(tmp_path: Path) -> None:
    arrays = build_synthetic_arrays(SYSTEMS["tcp"], 60, seed=0)
    arrays["scenario"] = (np.arange(60) // 3).astype(np.int32)
    lines: list[str] = []
    run = TrainingRun("tcp", replace(OPTIONS, steps=4), "cpu", tmp_path, arrays, sources=("made up",))
    path = run_training(run, lines.append)
    found = json.loads((tmp_path / "validation.json").read_text())
    assert found["samples"] == 3 * SCENARIOS_PER_PLACE and found["plan"]["ade_3s_m"] > 0
    assert len([name for _, name, _ in read_curves(tmp_path / "curves.csv") if name == "validation/ade_3s_m"]) == 4
    summary = load_checkpoint(path).summary
    assert (
        summary["samples"] == 60 - 3 * SCENARIOS_PER_PLACE
        and summary["sources"] == ["made up"]
        and summary["device"] == "CPU"
    )
    assert any("constant velocity 0.000 m" in line for line in lines)
    lines.clear()
    run_training(replace(run, is_resumed=True), lines.append)
    assert "going on from step 4" in lines[0]
    assert load_checkpoint(path).summary["losses"] == summary["losses"] != {}


def test_the_weights_with_the_least_validation_error_are_given_away(tmp_path: Path) -> None:
    trainer, data = make_trainer(options=replace(OPTIONS, steps=4))
    states: list[dict[str, torch.Tensor]] = []

    def look(network: torch.nn.Module) -> dict[str, float]:
        states.append({name: each.clone() for name, each in network.state_dict().items()})
        return {Trainer.chosen_by: (3.0, 1.0, 2.0, 1.0)[len(states) - 1]}

    trainer.train(data, np.ones(4), tmp_path, look)
    assert len(states) == 4  # after three of the steps, and at the end
    assert trainer.summary["best"] == {"step": 3, Trainer.chosen_by: 1.0}
    whole, weights = load_checkpoint(tmp_path), load_checkpoint(tmp_path / WEIGHTS_NAME)
    for name, expected in states[1].items():
        assert torch.equal(whole.chosen[name], expected) and torch.equal(weights.average[name], expected)
        assert torch.equal(trainer.copy_best().state_dict()[name], expected)
    assert any(not torch.equal(whole.average[name], expected) for name, expected in states[1].items())
    other, _ = make_trainer(options=replace(OPTIONS, steps=4))
    other.resume(whole)
    assert all(torch.equal(other.best[name], expected) for name, expected in states[1].items())


def silent(_: str) -> None:
    """No progress."""


def make_run(folder: Path) -> TrainingRun:
    arrays = build_synthetic_arrays(SYSTEMS["tcp"], 30, seed=0)
    return TrainingRun("tcp", replace(OPTIONS, steps=2), "cpu", folder, arrays, sources=("data/a",))


def test_a_resumed_run_is_the_run_that_began_and_no_other_begins_over_it(tmp_path: Path) -> None:
    run = make_run(tmp_path)
    run_training(run, silent)
    with pytest.raises(InputError, match="expected no training there, found one; --resume goes on with it"):
        run_training(run, silent)
    longer = replace(OPTIONS, steps=4)
    changes: tuple[tuple[dict[str, Any], str], ...] = (
        ({"sources": ("data/b",)}, r"sources: expected \['data/a'\], as the training began, found \['data/b'\]"),
        ({"options": replace(longer, seed=9)}, "--seed: expected 0, as the training began, found 9"),
        ({"options": replace(longer, batch=4)}, "--batch: expected 2, as the training began, found 4"),
        ({"data": build_synthetic_arrays(SYSTEMS["tcp"], 20, seed=0)}, "kinds: expected {'cruise': "),
    )
    for change, message in changes:
        with pytest.raises(InputError, match=message):
            run_training(replace(run, is_resumed=True, **change), silent)
    resumed = replace(run, is_resumed=True, options=replace(longer, learning_rate=1e-4))
    assert load_checkpoint(run_training(resumed, silent)).step == 4


def test_a_run_goes_on_on_another_kind_of_device(tmp_path: Path) -> None:
    """The state of a GPU's random numbers has another size."""
    trainer, data = make_trainer()
    trainer.save(tmp_path)
    checkpoint = load_whole_checkpoint(tmp_path, "tcp")
    checkpoint.generator = torch.zeros(16, dtype=torch.uint8)
    trainer.resume(checkpoint)
    trainer.train(data, np.ones(4), tmp_path)
    assert trainer.step == OPTIONS.steps


def test_ctrl_c_keeps_a_whole_checkpoint(tmp_path: Path) -> None:
    trainer, data = make_trainer(options=replace(OPTIONS, steps=1000, log_every=1))
    lines: list[str] = []

    def interrupt(line: str) -> None:
        lines.append(line)
        if len(lines) == 3:
            signal.raise_signal(signal.SIGINT)

    trainer._report = interrupt
    with pytest.raises(KeyboardInterrupt):
        trainer.train(data, np.ones(4), tmp_path)
    assert load_whole_checkpoint(tmp_path, "tcp").step == trainer.step == 3
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_weights_of_another_version_do_not_go_on(tmp_path: Path) -> None:
    trainer, _ = make_trainer()
    trainer.save(tmp_path)
    checkpoint = load_whole_checkpoint(tmp_path, "tcp")
    checkpoint.network["no such layer"] = torch.zeros(1)
    with pytest.raises(InputError, match=r"expected weights of the network of this version .* Unexpected key"):
        trainer.resume(checkpoint)


def test_a_loss_that_is_no_number_ends_training(tmp_path: Path) -> None:
    trainer, data = make_trainer()
    for each in trainer.network.parameters():
        each.data.fill_(float("nan"))
    with pytest.raises(InputError, match=r"loss 'plan' at step 1: expected a finite number, found nan; give --resume"):
        trainer.train(data, np.ones(4), tmp_path)
    assert not (tmp_path / CHECKPOINT_NAME).exists()


def test_a_gpu_that_is_too_small_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise torch.cuda.OutOfMemoryError

    monkeypatch.setattr(training, "compute_losses", refuse)
    with pytest.raises(
        InputError,
        match=r"memory is too small for a batch of 2: give --batch 1 and another --out, and --init .*weights",
    ):
        run_training(make_run(tmp_path), silent)


@pytest.mark.parametrize("content", [None, b"", b"no checkpoint", b"PK\x03\x04"])
def test_what_is_no_checkpoint_is_refused(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / CHECKPOINT_NAME
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"expected a checkpoint of `learn train`, found"):
        load_checkpoint(path)


def test_a_checkpoint_of_another_system_is_refused(tmp_path: Path) -> None:
    trainer, _ = make_trainer()
    trainer.save(tmp_path)
    with pytest.raises(InputError, match="expected a checkpoint of 'vad', found one of 'tcp'"):
        load_checkpoint(tmp_path, "vad")


def test_weights_alone_begin_another_run_but_do_not_resume_one(tmp_path: Path) -> None:
    trainer, _ = make_trainer()
    trainer.save(tmp_path)
    weights = tmp_path / WEIGHTS_NAME
    assert weights.stat().st_size < 0.6 * (tmp_path / CHECKPOINT_NAME).stat().st_size
    other, _ = make_trainer(options=replace(OPTIONS, seed=1))
    other.begin_with(load_checkpoint(weights, "tcp"))
    first = next(iter(other.network.parameters()))
    assert torch.equal(first, next(iter(trainer.network.parameters())))
    with pytest.raises(InputError, match=r"expected a checkpoint.pt to go on from, found weights only; give --init"):
        load_whole_checkpoint(weights, "tcp")


def test_a_missing_gpu_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    arguments = ["learn", "train", "tcp", "--data", str(tmp_path), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2 and "--device cuda: expected a GPU that PyTorch" in result.output
