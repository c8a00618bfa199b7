"""`mdrive-sumo learn train-detector`, `export-detector` and `evaluate-detectors`."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mdrive_sumo.agents.learned.fusion_spec import BOUNDS, FUSIONS, SHARING, TRAINED
from mdrive_sumo.cli.options import FiniteRange
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.require_torch import require_torch
from mdrive_sumo.runs.evaluate import report_write_errors

if TYPE_CHECKING:
    from mdrive_sumo.learning.fusion.frames import FusionFrames

FOLDER = click.Path(path_type=Path, file_okay=False)
ORDER = (*BOUNDS, *FUSIONS)


@click.command("train-detector")
@click.argument("detector", type=click.Choice(TRAINED))
@click.option("--data", multiple=True, type=FOLDER, help="Frames of `learn scans`; may repeat.")
@click.option("--val", multiple=True, type=FOLDER, help="Frames of other places, which choose the best weights.")
@click.option("--device", type=click.Choice(("cuda", "cpu")), default="cuda", show_default=True)
@click.option("--out", type=FOLDER, required=True, help="Folder for checkpoint, best weights and curves.")
@click.option("--steps", type=click.IntRange(1, 10_000_000), default=6000, show_default=True)
@click.option("--batch", type=click.IntRange(1, 4096), default=32, show_default=True, help="Frames of one step.")
@click.option("--learning-rate", type=FiniteRange(1e-7, 1.0), default=1e-3, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True)
@click.option("--max-minutes", type=FiniteRange(0.01, 1e5), help="End by then, with the learning rate run out.")
@click.option("--resume", is_flag=True, help="Go on from the checkpoint in --out.")
@click.option(
    "--init",
    type=click.Path(path_type=Path),
    metavar="CHECKPOINT",
    help="Begin with encoder and head of any detector; a training's folder: its best weights.",
)
@click.option(
    "--teacher",
    type=click.Path(path_type=Path),
    metavar="CHECKPOINT",
    help="A trained `early`, which `disconet` needs; a training's folder: its best weights.",
)
@click.option(
    "--gate/--no-gate",
    "is_gated",
    default=True,
    show_default=True,
    help="Whether a fusion can fall back to its own map.",
)
@click.option("--alone", "is_alone", is_flag=True, help="Never show it what others send: a twin for `codriving:alone`.")
@click.option("--smoke", is_flag=True, help="150 steps on two made-up frames, exit 1 unless it knows them by heart.")
def train_command(detector: str, data: tuple[Path, ...], val: tuple[Path, ...], out: Path, **options: Any) -> None:
    """Train a detector that shares features, or one of its bounds.

    Writes best.pt (the best averaged weights so far), checkpoint.pt, weights.pt, curves.csv and curves.png (--smoke:
    into OUT/smoke). `late` has no training: it merges the boxes of `none`. Needs the extra `learn`.
    """
    require_torch("learn train-detector")
    if options["smoke"]:
        _run_smoke_test(detector, out, options["is_gated"])
        return
    for name, folders in (("--data", data), ("--val", val)):
        if not folders:
            raise click.UsageError(f"{name}: expected at least one data set of `learn scans`, found none")
    try:
        _train(detector, data, val, out, options)
    except KeyboardInterrupt:
        where = "--resume goes on with" if _is_begun(out) else "nothing is kept in"
        echo(f"interrupted; {where} {out}", err=True)
        raise click.exceptions.Exit(130) from None


def _run_smoke_test(detector: str, out: Path, is_gated: bool) -> None:
    from mdrive_sumo.learning.fusion.training.fusion_smoke_test import COMPARED, STEPS, run_fusion_smoke_test

    found = run_fusion_smoke_test(detector, out / "smoke", is_gated)
    echo(
        f"{detector}: mean loss of the first {COMPARED} of {STEPS} steps {found.first:.3f}, of the last"
        f" {found.last:.3f}; average precision on the same frames {found.precision:.3f}"
    )
    if not found.has_learned:
        echo("it did not learn the frames", err=True)
        raise click.exceptions.Exit(1)


def _is_begun(out: Path) -> bool:
    from mdrive_sumo.learning.training.checkpoint import CHECKPOINT_NAME

    return (out / CHECKPOINT_NAME).is_file()


def _train(detector: str, data: tuple[Path, ...], val: tuple[Path, ...], out: Path, options: dict[str, Any]) -> None:
    from mdrive_sumo.learning.fusion.training.run_fusion_training import (
        FusionRun,
        check_teacher,
        find_best_weights,
        run_fusion_training,
    )
    from mdrive_sumo.learning.training.checkpoint import check_unused
    from mdrive_sumo.learning.training.run_training import find_device
    from mdrive_sumo.learning.training.training_options import TrainingOptions

    find_device(options["device"])  # before the data is read
    initial, teacher = (
        None if options[name] is None else find_best_weights(options[name], f"--{name}") for name in ("init", "teacher")
    )
    check_teacher(detector, teacher)
    if not options["resume"]:
        check_unused(out)
    elif not _is_begun(out):
        raise InputError(f"--resume: expected a training to go on with in {out}, found none")
    training = TrainingOptions(
        steps=options["steps"], batch=options["batch"], learning_rate=options["learning_rate"], seed=options["seed"],
        max_minutes=options["max_minutes"],
    )  # fmt: skip
    run = FusionRun(
        detector=detector, options=training, device=options["device"], folder=out, data=_read(data),
        validation=_read(val), is_gated=options["is_gated"] and detector in SHARING,
        is_alone=options["is_alone"], is_resumed=options["resume"], initial=initial, teacher=teacher,
        sources=tuple(map(str, data)),
    )  # fmt: skip
    path = run_fusion_training(run, echo)
    echo(f"{path}  `learn export-detector {detector} --checkpoint {out} --out DIR` makes weights to drive with")


def _read(folders: tuple[Path, ...]) -> "FusionFrames":
    from mdrive_sumo.learning.fusion.frame_files import read_frames
    from mdrive_sumo.learning.fusion.frames import concatenate_frames

    began = time.monotonic()
    frames = concatenate_frames([read_frames(folder) for folder in folders])
    scans, gigabytes = len(frames.scan_starts) - 1, frames.cells.nbytes / 1e9
    echo(
        f"{', '.join(map(str, folders))}: {len(frames)} frames of {len(frames.places)} places, {scans} scans,"
        f" {gigabytes:.1f} GB, read in {time.monotonic() - began:.0f} s"
    )
    return frames


@click.command("export-detector")
@click.argument("detector", type=click.Choice(TRAINED))
@click.option(
    "--checkpoint",
    type=click.Path(path_type=Path),
    required=True,
    help="Of `learn train-detector`; its folder: the best weights.",
)
@click.option("--out", type=FOLDER, required=True, help="Folder for the files.")
def export_command(detector: str, checkpoint: Path, out: Path) -> None:
    """Write DETECTOR-encoder.onnx and DETECTOR.onnx (weights in half precision) with their manifests.

    Their answers are checked against PyTorch's. Needs the extras `learn` and `learned`.
    """
    require_torch("learn export-detector", "onnxruntime")
    from mdrive_sumo.learning.fusion.training.export_fusion import export_fusion
    from mdrive_sumo.learning.fusion.training.run_fusion_training import find_best_weights
    from mdrive_sumo.learning.training.checkpoint import load_checkpoint

    exported = export_fusion(load_checkpoint(find_best_weights(checkpoint, "--checkpoint"), detector), out)
    echo(
        f"{exported.encoder} and {exported.fusion.name}  {exported.bytes / 1e6:.2f} MB, differ from PyTorch by"
        f" {exported.difference:.1e} at most, by {exported.rounding:.1e} before weights were rounded"
    )


@click.command("evaluate-detectors")
@click.argument("detectors", nargs=-1, type=click.Choice(ORDER))
@click.option("--data", multiple=True, type=FOLDER, required=True, help="Frames of `learn scans --split test`.")
@click.option(
    "--checkpoints",
    type=FOLDER,
    required=True,
    help="Folder of trainings: NAME/best.pt of each detector; `late` takes that of `none`.",
)
@click.option("--out", type=FOLDER, required=True, help="Folder for figures and tables.")
@click.option("--device", type=click.Choice(("cuda", "cpu")), default="cuda", show_default=True)
@click.option("--frames", type=click.IntRange(1), help="Measure on so many, spread over all.  [default: all]")
def evaluate_command(
    detectors: tuple[str, ...], data: tuple[Path, ...], checkpoints: Path, out: Path, device: str, frames: int | None
) -> None:
    """Measure DETECTORS (all, without a name), and write the tables of those that are measured.

    Each writes OUT/NAME.figures.npz, so that processes can share the work; a detector that is measured already is not
    measured again. OUT/detectors.json and OUT/detectors.md hold the tables. Needs the extra `learn`.
    """
    require_torch("learn evaluate-detectors")
    from mdrive_sumo.learning.fusion.detector_figures import SUFFIX, check_comparable, read_figures, write_figures
    from mdrive_sumo.learning.fusion.detector_tables import (
        summarise_detectors,
        write_detectors_json,
        write_detectors_page,
    )
    from mdrive_sumo.learning.fusion.training.measure_detector import measure_detector, name_trained
    from mdrive_sumo.learning.fusion.training.run_fusion_training import find_best_weights
    from mdrive_sumo.learning.training.run_training import find_device

    where = find_device(device)
    missing = [name for name in detectors or ORDER if not (out / f"{name}{SUFFIX}").is_file()]
    weights = {name: find_best_weights(checkpoints / name_trained(name), "--checkpoints") for name in missing}
    with report_write_errors(out):  # before minutes of work
        make_folder(out)
    judged = _spread(_read(data), frames) if missing else None
    for name in missing:
        assert judged is not None
        began = time.monotonic()
        figures = measure_detector(name, weights[name], judged, where, lambda line: echo(line, err=True))
        with report_write_errors(out):
            path = write_figures(out, figures)
        echo(f"{path}  measured in {time.monotonic() - began:.0f} s")
    measured = {name: read_figures(path) for name in ORDER if (path := out / f"{name}{SUFFIX}").is_file()}
    check_comparable(measured)
    summary = summarise_detectors(measured)
    page = write_detectors_page(summary)
    with report_write_errors(out):
        write_text(out / "detectors.json", write_detectors_json(summary))
        write_text(out / "detectors.md", page)
    echo(page)


def _spread(frames: "FusionFrames", count: int | None) -> "FusionFrames":
    """Return so many frames, at equal steps over all."""
    import numpy as np

    from mdrive_sumo.learning.fusion.frames import take_frames

    if count is None or count >= len(frames):
        return frames
    return take_frames(frames, np.linspace(0, len(frames) - 1, count).astype(np.int64))
