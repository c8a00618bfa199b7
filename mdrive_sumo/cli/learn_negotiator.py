"""`mdrive-sumo learn train-negotiator`, `export-negotiator` and `evaluate-negotiator`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.cli.options import FiniteRange
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.require_torch import require_torch
from mdrive_sumo.runs.evaluate import report_write_errors

FOLDER = click.Path(path_type=Path, file_okay=False)


@click.command("train-negotiator")
@click.option("--data", type=FOLDER, help="Dialogues to train on.")
@click.option("--val", type=FOLDER, help="Dialogues of other places, which choose the best weights.")
@click.option("--pairs", is_flag=True, help="Learn which of two answers drives better, from the pairs in --data.")
@click.option("--device", type=click.Choice(("cuda", "cpu")), default="cuda", show_default=True)
@click.option("--out", type=FOLDER, required=True, help="Folder for checkpoint and curves.")
@click.option("--steps", type=click.IntRange(1, 10_000_000), default=20_000, show_default=True)
@click.option("--batch", type=click.IntRange(1, 65_536), default=256, show_default=True, help="Dialogues of one step.")
@click.option("--learning-rate", type=FiniteRange(1e-7, 1.0), default=1e-3, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True)
@click.option("--max-minutes", type=FiniteRange(0.01, 1e5), help="End by then, with the learning rate run out.")
@click.option("--resume", is_flag=True, help="Go on from the checkpoint in --out.")
@click.option(
    "--init", type=click.Path(path_type=Path), metavar="CHECKPOINT", help="Begin with its weights; --pairs needs one."
)
@click.option("--smoke", is_flag=True, help="A small network, 8 made-up dialogues; exit 1 unless it knows them.")
def train_command(data: Path | None, val: Path | None, out: Path, **options: Any) -> None:
    """Train the language model that negotiates for `colmdriver`.

    Writes checkpoint.pt, weights.pt, curves.csv and curves.png (--smoke: into OUT/smoke). Needs the extra `learn`.
    """
    require_torch("learn train-negotiator")
    if options["smoke"]:
        _run_smoke_test(out)
        return
    if data is None or val is None:
        raise click.UsageError(f"{'--data' if data is None else '--val'}: expected a folder of dialogues, found none")
    try:
        _train(data, val, out, options)
    except KeyboardInterrupt:
        echo(f"interrupted; --resume goes on with {out}", err=True)
        raise click.exceptions.Exit(130) from None


def _run_smoke_test(out: Path) -> None:
    from mdrive_sumo.learning.dialogue.training.dialogue_smoke_test import run_dialogue_smoke_test

    found = run_dialogue_smoke_test(out / "smoke")
    echo(f"negotiator: {found.known:.0%} of the heads known by heart, loss {found.words:.2f} an entry of words")
    if not found.has_learned:
        echo("it did not learn the dialogues", err=True)
        raise click.exceptions.Exit(1)


def _train(data: Path, val: Path, out: Path, options: dict[str, Any]) -> None:
    from mdrive_sumo.learning.dialogue.dialogue_files import read_dialogues, read_pairs
    from mdrive_sumo.learning.dialogue.training.run_dialogue_training import DialogueRun, run_dialogue_training
    from mdrive_sumo.learning.training.checkpoint import CHECKPOINT_NAME, check_unused
    from mdrive_sumo.learning.training.run_training import find_device
    from mdrive_sumo.learning.training.training_options import TrainingOptions
    from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary

    find_device(options["device"])  # before the data is read
    if not options["resume"]:
        check_unused(out)
    elif not (out / CHECKPOINT_NAME).is_file():
        raise InputError(f"--resume: expected a training to go on with in {out}, found none")
    vocabulary = load_vocabulary().digest
    names = ("steps", "batch", "learning_rate", "seed", "max_minutes")
    run = DialogueRun(
        options=TrainingOptions(**{name: options[name] for name in names}),
        device=options["device"],
        folder=out,
        data=read_dialogues(data, vocabulary),
        judged=read_dialogues(val, vocabulary),
        pairs=read_pairs(data, vocabulary) if options["pairs"] else None,
        is_resumed=options["resume"],
        initial=options["init"],
    )
    path = run_dialogue_training(run, echo)
    echo(f"{path}  `learn export-negotiator --checkpoint {out} --data {val} --out DIR` makes weights to drive with")


@click.command("export-negotiator")
@click.option("--checkpoint", type=click.Path(path_type=Path), required=True, help="Of `learn train-negotiator`.")
@click.option("--data", type=FOLDER, required=True, help="Dialogues to compare answers on.")
@click.option("--out", type=FOLDER, required=True, help="Folder for the files.")
def export_command(checkpoint: Path, data: Path, out: Path) -> None:
    """Write negotiator.onnx (weights in 8 bits) with its manifest.

    Its answers are checked against PyTorch's, and timed. Needs the extras `learn` and `learned`.
    """
    require_torch("learn export-negotiator", "onnxruntime")
    from mdrive_sumo.learning.dialogue.dialogue_files import read_dialogues
    from mdrive_sumo.learning.dialogue.training.export_decoder import export_decoder
    from mdrive_sumo.learning.training.checkpoint import load_checkpoint
    from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM
    from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary

    samples = read_dialogues(data, load_vocabulary().digest)
    exported = export_decoder(load_checkpoint(checkpoint, SYSTEM), checkpoint, samples, out)
    echo(
        f"{exported.network}  {exported.network.stat().st_size / 1e6:.2f} MB, {exported.equal_heads:.1%} of the heads"
        f" as before rounding; {exported.message_ms[0]:.0f} ms of one core a message, 99 % below"
        f" {exported.message_ms[1]:.0f} ms"
    )


@click.command("evaluate-negotiator")
@click.option("--data", type=FOLDER, required=True, help="Dialogues of places that it was not trained on.")
@click.option(
    "--weights", type=click.Path(path_type=Path, dir_okay=False), help="negotiator.onnx  [default: the packaged one]"
)
@click.option("--dialogues", type=click.IntRange(1, 1_000_000), default=1000, show_default=True, help="At most.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write the numbers to this JSON file.")
def evaluate_command(data: Path, weights: Path | None, dialogues: int, out: Path | None) -> None:
    """Compare the answers of the language model with those that were taught, by size of the group.

    Runs exported weights as they drive (ONNX Runtime on one core; no PyTorch is needed).
    """
    import numpy as np

    from mdrive_sumo.learning.dialogue.dialogue_files import read_dialogues
    from mdrive_sumo.learning.dialogue.evaluate_decoder import evaluate_decoder
    from mdrive_sumo.negotiation.dialogue.dialogue_decoder import WEIGHTS, load_decoder

    decoder = load_decoder(weights or WEIGHTS)
    samples = read_dialogues(data, decoder.vocabulary.digest)
    if out is not None:
        with report_write_errors(out):  # before minutes of work
            make_parents(out)
    rows = np.unique(np.linspace(0, len(samples) - 1, dialogues).astype(int)).tolist()
    scores = evaluate_decoder(decoder, samples, rows)
    header = ("task", "members", "dialogues", "order", "order and actions", "head")
    lines = [
        (
            one.task,
            str(one.members),
            str(one.dialogues),
            *(f"{share:.3f}" for share in (one.order, one.actions, one.head)),
        )
        for one in scores
    ]
    echo(format_text(make_text_table(header, lines)))
    if out is not None:
        with report_write_errors(out):
            write_text(out, json.dumps([asdict(one) for one in scores], indent=1) + "\n")
