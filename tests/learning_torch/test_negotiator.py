"""The negotiator: no entry sees later ones, the cache changes nothing, it learns, prefers, and is exported."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch
from click.testing import CliRunner, Result
from torch import Tensor

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.dialogue.dialogue_files import write_dialogues
from mdrive_sumo.learning.dialogue.dialogue_samples import DialogueSamples
from mdrive_sumo.learning.dialogue.networks.decoder_network import CachedDecoder, DecoderNetwork
from mdrive_sumo.learning.dialogue.synthetic_dialogues import (
    build_synthetic_dialogues,
    build_synthetic_pairs,
    draw_dialogue,
)
from mdrive_sumo.learning.dialogue.training import export_decoder as exporting
from mdrive_sumo.learning.dialogue.training import run_dialogue_training as running
from mdrive_sumo.learning.dialogue.training.dialogue_losses import (
    compute_answer_likelihood,
    compute_dialogue_losses,
    compute_preference_loss,
)
from mdrive_sumo.learning.dialogue.training.dialogue_smoke_test import SMALL
from mdrive_sumo.learning.dialogue.training.dialogue_store import DialogueBatch, DialogueStore
from mdrive_sumo.learning.dialogue.training.dialogue_trainer import DialogueJudge, PreferenceTrainer
from mdrive_sumo.learning.dialogue.training.export_decoder import export_decoder
from mdrive_sumo.learning.dialogue.training.run_dialogue_training import DialogueRun, run_dialogue_training
from mdrive_sumo.learning.networks.build_network import count_parameters
from mdrive_sumo.learning.training import trainer as training
from mdrive_sumo.learning.training.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from mdrive_sumo.learning.training.training_options import TrainingOptions
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import load_decoder
from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM
from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary

CPU = torch.device("cpu")
VOCABULARY = load_vocabulary()


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, ["learn", *map(str, arguments)])


def draw_samples(count: int, split: str = "train") -> DialogueSamples:
    return build_synthetic_dialogues(VOCABULARY, count, 0, split, most_members=2)


def make_run(folder: Path, steps: int = 2) -> DialogueRun:
    options = TrainingOptions(steps=steps, batch=2, learning_rate=5e-3, log_every=1, average_decay=0.5)
    return DialogueRun(options, "cpu", folder, draw_samples(4), draw_samples(2, "val"), shape=SMALL)


@pytest.fixture
def network() -> DecoderNetwork:
    torch.manual_seed(0)
    return DecoderNetwork(SMALL).eval()


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The smoke test's weights."""
    folder = tmp_path_factory.mktemp("smoke")
    result = run("train-negotiator", "--smoke", "--out", folder)
    assert result.exit_code == 0, result.output
    assert "of the heads known by heart" in result.output
    return folder / "smoke"


def test_the_network_has_nine_million_numbers() -> None:
    assert count_parameters(DecoderNetwork(NEGOTIATOR)) == 9_292_576


def test_no_entry_sees_later_ones_and_the_cache_changes_nothing(network: DecoderNetwork) -> None:
    entries = torch.arange(20) * 37 % SMALL.vocabulary
    with torch.no_grad():
        whole = network.score(network(entries[None]))[0]
        torch.testing.assert_close(network.score(network(entries[None, :12]))[0], whole[:12])
        cached = CachedDecoder(network)
        past, scores = torch.zeros(0, *SMALL.cache_shape), torch.zeros(0)
        for part in entries.split((11, 1, 8)):
            scores, present = cached(part, past)
            past = torch.cat((past, present))
        torch.testing.assert_close(scores, whole[-1], atol=1e-5, rtol=1e-5)


def test_losses_count_what_they_say(network: DecoderNetwork) -> None:
    batch = DialogueStore(draw_samples(4), CPU).take(torch.arange(4))
    assert batch.entries.shape[1] % 32 == 0 and int(batch.length.max()) <= batch.entries.shape[1]

    class Sure:
        """Knows every entry of heads, and nothing else."""

        def __call__(self, entries: Tensor) -> Tensor:
            return torch.zeros(*entries.shape, 1)

        def score(self, features: Tensor) -> Tensor:
            scores = torch.zeros(*features.shape[:2], SMALL.vocabulary)
            right = torch.nn.functional.one_hot(batch.entries[:, 1:], SMALL.vocabulary).float()
            return torch.where(batch.find_head()[..., None], 100.0 * right, scores)

        def judge_fields(self, features: Tensor) -> tuple[Tensor, Tensor]:
            return torch.zeros(len(features), 8, 8), torch.zeros(len(features), 8, 4)

    losses = compute_dialogue_losses(Sure(), batch)
    assert float(losses["head"]) == pytest.approx(0.0, abs=1e-6)
    assert float(losses["words"]) == pytest.approx(math.log(SMALL.vocabulary))
    assert float(losses["prompt"]) == pytest.approx(math.log(SMALL.vocabulary))
    assert float(losses["fields"]) == pytest.approx(math.log(8) + math.log(4))
    words = int((batch.length - batch.head_end).sum())
    expected = -words / 4 * math.log(SMALL.vocabulary)
    assert float(compute_answer_likelihood(Sure(), batch).mean()) == pytest.approx(expected)
    judged = DialogueJudge(DialogueStore(draw_samples(4), CPU)).look(network)
    assert judged["validation/wrong_head"] == 1.0


def test_rows_of_padding_change_no_loss(network: DecoderNetwork) -> None:
    samples = draw_samples(4)
    batch = DialogueStore(samples, CPU).take(torch.arange(4))
    padded = DialogueBatch(torch.nn.functional.pad(batch.entries, (0, 64)), *batch[1:])
    with torch.no_grad():
        for name, value in compute_dialogue_losses(network, batch).items():
            torch.testing.assert_close(compute_dialogue_losses(network, padded)[name], value)


def test_the_preference_loss_is_that_of_its_paper() -> None:
    better, worse = torch.tensor([-1.0, -5.0]), torch.tensor([-3.0, -5.0])
    before = torch.tensor([-2.0, -5.0]), torch.tensor([-2.0, -5.0])
    expected = (-math.log(1 / (1 + math.exp(-0.1 * 2.0))) - math.log(0.5)) / 2
    assert float(compute_preference_loss(better, worse, *before)) == pytest.approx(expected, rel=1e-5)


def test_training_on_pairs_prefers_the_better_answers(trained: Path) -> None:
    pairs = build_synthetic_pairs(VOCABULARY, 4, 0)
    options = TrainingOptions(steps=16, batch=4, learning_rate=5e-3, average_decay=0.5)
    trainer = PreferenceTrainer(options, CPU, str, SMALL)
    trainer.begin_with(load_checkpoint(trained / "weights.pt", SYSTEM))
    store = trainer.prepare_pairs(pairs)
    rows = torch.arange(4)
    with torch.no_grad():
        first = trainer._compute_losses(store, rows)
    assert float(first["preference"]) == pytest.approx(math.log(2), rel=1e-4), "nothing has changed yet"
    for step in range(16):
        trainer._take_step(store, torch.ones(4), step / 16)
        trainer.step += 1
    with torch.no_grad():
        last = trainer._compute_losses(store, rows)
    assert float(last["preference"]) < 0.6 and float(last["preferred"]) > 0.5


class Stopped(Exception):
    pass


def test_an_interrupted_training_ends_with_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "GLANCES", 1)
    whole = load_checkpoint(run_dialogue_training(make_run(tmp_path / "whole", steps=4), str))
    assert whole.summary["vocabulary"] == VOCABULARY.digest and whole.summary["places"] == 4
    part = make_run(tmp_path / "part", steps=4)
    part = replace(part, options=replace(part.options, save_every_s=0.0))

    def stop_in_the_third_step(line: str) -> None:
        if line.startswith("step 3"):
            raise Stopped

    with pytest.raises(Stopped):
        run_dialogue_training(part, stop_in_the_third_step)
    told: list[str] = []
    resumed = load_checkpoint(run_dialogue_training(replace(part, is_resumed=True), told.append))
    assert "going on from step 2" in told[0]
    assert all(torch.equal(value, resumed.network[name]) for name, value in whole.network.items())
    other = replace(part, is_resumed=True, options=replace(part.options, seed=5))
    with pytest.raises(InputError, match="--seed: expected 0, as the training began, found 5"):
        run_dialogue_training(other, str)
    with pytest.raises(InputError, match="dialogues: expected 4, as the training began, found 3"):
        run_dialogue_training(replace(part, is_resumed=True, data=draw_samples(3)), str)


def test_weights_answer_in_8_bits_as_pytorch_does(trained: Path, tmp_path: Path) -> None:
    samples = build_synthetic_dialogues(VOCABULARY, 8, 0, most_members=2)  # those that it knows by heart
    path = trained / "weights.pt"
    checkpoint = load_checkpoint(trained / "checkpoint.pt", SYSTEM)
    checkpoint.best = {}
    exported = export_decoder(checkpoint, path, samples, tmp_path)
    assert exported.difference < 1e-3 and exported.equal_heads >= 0.97 and exported.message_ms[0] > 0
    decoder = load_decoder(exported.network)
    dialogues = [draw_dialogue(VOCABULARY, 0, i, most_members=2) for i in range(8)]
    answers = [decoder.answer(each.task, each.lines, each.letters, has_words=False).text for each in dialogues]
    right = [one.answer.startswith(answer) for one, answer in zip(dialogues, answers, strict=True)]
    assert sum(right) >= 7


def test_weights_that_rounding_changes_are_refused(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint = load_checkpoint(trained / "weights.pt", SYSTEM)
    with pytest.raises(InputError, match="expected 110% of the heads of answers to survive rounding to 8 bits, found"):
        export_decoder(checkpoint, trained, draw_samples(2), tmp_path, least_equal=1.1)
    monkeypatch.setattr(exporting, "MOST_BYTES", 1000)
    with pytest.raises(InputError, match="expected at most 1000 bytes, found"):
        export_decoder(checkpoint, trained, draw_samples(2), tmp_path, least_equal=0.0)
    monkeypatch.setattr(exporting, "MOST_DIFFERENCE", 0.0)
    with pytest.raises(InputError, match="expected scores within 0\\.0 of PyTorch's, found a difference of"):
        export_decoder(checkpoint, trained, draw_samples(2), tmp_path, least_equal=0.0)


def write_checkpoint(trained: Path, folder: Path, **summary: object) -> Path:
    checkpoint = load_checkpoint(trained / "weights.pt", SYSTEM)
    changed = Checkpoint(SYSTEM, 1, 0.0, {}, checkpoint.average, {}, None, checkpoint.summary | summary)
    return save_checkpoint(changed, folder)


def test_bad_checkpoints_are_sentences(trained: Path, tmp_path: Path) -> None:
    write_dialogues(tmp_path / "val", "val", [draw_samples(2, "val")])
    write_dialogues(tmp_path / "train", "train", [draw_samples(2)])
    old = write_checkpoint(trained, tmp_path / "old", vocabulary="0" * 32)
    shapeless = write_checkpoint(trained, tmp_path / "shapeless", shape=3)
    wide = write_checkpoint(trained, tmp_path / "wide", shape={"width": 320})
    out = ("--data", tmp_path / "val", "--out", tmp_path / "weights")
    data = ("--data", tmp_path / "train", "--val", tmp_path / "val", "--device", "cpu", "--steps", "1")
    cases = [
        (("export-negotiator", "--checkpoint", old, *out), "expected weights of the vocabulary"),
        (("export-negotiator", "--checkpoint", shapeless, *out), "expected the shape of a decoder, found none"),
        (("export-negotiator", "--checkpoint", wide, *out), "expected weights of the network of this version"),
        (
            ("export-negotiator", "--checkpoint", tmp_path, *out),
            "expected a checkpoint of `learn train`, found no file",
        ),
        (("train-negotiator", *data, "--out", tmp_path / "a", "--init", old), "expected weights of the vocabulary"),
        (("train-negotiator", *data, "--out", tmp_path / "a", "--init", wide), "expected weights of the network of"),
        (("train-negotiator", *data, "--out", tmp_path / "a", "--resume"), "--resume: expected a training to go on"),
        (("train-negotiator", *data, "--out", tmp_path / "a", "--pairs"), "expected pairs of better and worse answers"),
        (("train-negotiator", *data, "--out", tmp_path / "old"), "expected no training there, found one"),
        (("train-negotiator", "--out", tmp_path / "a"), "--data: expected a folder of dialogues, found none"),
        (("train-negotiator", *data[:2], "--out", tmp_path / "a"), "--val: expected a folder of dialogues, found none"),
        (
            ("train-negotiator", *data[:3], tmp_path / "train", *data[4:], "--out", tmp_path / "a"),
            "expected places without training, found",
        ),
    ]
    for arguments, expected in cases:
        result = run(*arguments)
        assert result.exit_code == 2 and expected in result.output, (arguments, result.output)
        assert "Traceback" not in result.output


def test_pairs_need_trained_weights_and_begin_anew(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="training on pairs: expected --init with trained weights"):
        run_dialogue_training(replace(make_run(tmp_path), pairs=build_synthetic_pairs(VOCABULARY, 2, 0)), str)


def test_from_dialogues_and_pairs_to_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "GLANCES", 1)
    monkeypatch.setattr(exporting.export_decoder, "__defaults__", (0.0,))  # one step teaches nothing
    monkeypatch.setattr(running, "DialogueRun", partial(DialogueRun, shape=SMALL))
    write_dialogues(tmp_path / "train", "train", [draw_samples(2)], build_synthetic_pairs(VOCABULARY, 2, 0))
    write_dialogues(tmp_path / "val", "val", [draw_samples(2, "val")])
    data = ("--data", tmp_path / "train", "--val", tmp_path / "val", "--device", "cpu", "--steps", 1, "--batch", 1)
    said = run("train-negotiator", *map(str, data), "--out", tmp_path / "said")
    assert said.exit_code == 0 and "negotiator: 2 dialogues, 2 for validation" in said.output, said.output
    begun = ("--pairs", "--init", tmp_path / "said" / "weights.pt")
    preferred = run("train-negotiator", *map(str, data), *begun, "--out", tmp_path / "preferred")
    assert preferred.exit_code == 0 and "negotiator: 2 pairs" in preferred.output, preferred.output
    checkpoint = tmp_path / "preferred" / "weights.pt"
    weights = ("--checkpoint", checkpoint, "--data", tmp_path / "val", "--out", tmp_path / "weights")
    exported = run("export-negotiator", *weights)
    assert exported.exit_code == 0 and "ms of one core a message" in exported.output, exported.output
    decoder = load_decoder(tmp_path / "weights" / "negotiator.onnx")
    assert decoder.shape == SMALL
    dialogue = draw_dialogue(VOCABULARY, 0, 0)
    assert decoder.answer(dialogue.task, dialogue.lines, dialogue.letters).written_entries > 4
