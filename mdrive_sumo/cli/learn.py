"""`mdrive-sumo learn`: training data, training, evaluation and export of learned systems."""

import json
from pathlib import Path

import click

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli.learn_data import command as data_command
from mdrive_sumo.cli.learn_demonstrations import command as demonstrations_command
from mdrive_sumo.cli.learn_detectors import evaluate_command as evaluate_detectors_command
from mdrive_sumo.cli.learn_detectors import export_command as export_detector_command
from mdrive_sumo.cli.learn_detectors import train_command as train_detector_command
from mdrive_sumo.cli.learn_dialogues import dialogues_command, situations_command
from mdrive_sumo.cli.learn_negotiator import evaluate_command as evaluate_negotiator_command
from mdrive_sumo.cli.learn_negotiator import export_command as export_negotiator_command
from mdrive_sumo.cli.learn_negotiator import train_command as train_negotiator_command
from mdrive_sumo.cli.learn_observation import command as observation_command
from mdrive_sumo.cli.learn_scans import command as scans_command
from mdrive_sumo.cli.learn_train import command as train_command
from mdrive_sumo.cli.options import workers_option
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.require_torch import require_torch
from mdrive_sumo.runs.evaluate import report_write_errors


@click.command("evaluate")
@click.argument("system", type=click.Choice(tuple(SYSTEMS)))
@click.option(
    "--data",
    multiple=True,
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Data set of `learn data --split val`; may repeat.",
)
@click.option(
    "--weights", type=click.Path(path_type=Path, dir_okay=False), help="NAME.onnx  [default: the packaged weights]"
)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write all metrics to this JSON file.")
@workers_option
def evaluate_command(system: str, data: tuple[Path, ...], weights: Path | None, out: Path | None, workers: int) -> None:
    """Compare the plans of a system with the expert's, against driving on at constant velocity and against blindness.

    Runs exported weights as they drive (ONNX Runtime on one core; no PyTorch is needed).
    """
    from mdrive_sumo.learning.evaluate_weights import evaluate_weights
    from mdrive_sumo.learning.sample_reader import load_arrays

    spec = SYSTEMS[system]
    arrays = load_arrays(data, spec, workers)
    if out is not None:
        with report_write_errors(out):  # before minutes of work
            make_parents(out)
    figures = evaluate_weights(spec, weights, arrays)
    figures["data"] = [str(each) for each in data]
    rows = [
        (name, *(f"{figures[key][metric]:.3f}" for metric in figures["plan"]))
        for name, key in ((system, "plan"), ("constant velocity", "constant_velocity"), ("blind", "blackout"))
    ]
    echo(format_text(make_text_table(("plans", *figures["plan"]), rows)))
    kinds = [(name, str(one["samples"]), f"{one['ade_3s_m']:.3f}") for name, one in figures["by_kind"].items()]
    echo("\n" + format_text(make_text_table(("the expert", "samples", "ade_3s_m"), kinds)))
    echo(f"\n{figures['samples']} samples; {figures['decision_ms']['median']:.1f} ms a decision on one core")
    if out is not None:
        with report_write_errors(out):
            write_text(out, json.dumps(figures, indent=1) + "\n")


@click.command("export")
@click.argument("system", type=click.Choice(tuple(SYSTEMS)))
@click.option("--checkpoint", type=click.Path(path_type=Path), required=True, help="checkpoint.pt of `learn train`.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the files.")
@click.option(
    "--data", multiple=True, type=click.Path(path_type=Path, file_okay=False), help="Compare on samples of it, too."
)
@workers_option
def export_command(system: str, checkpoint: Path, out: Path, data: tuple[Path, ...], workers: int) -> None:
    """Write SYSTEM.onnx (weights in half precision) and SYSTEM.json, and check its plans against PyTorch's.

    Needs the extras `learn` and `learned`.
    """
    require_torch("learn export", "onnxruntime")
    from mdrive_sumo.learning.sample_reader import load_arrays
    from mdrive_sumo.learning.training.checkpoint import load_checkpoint
    from mdrive_sumo.learning.training.export_network import export_network

    loaded = load_checkpoint(checkpoint, system)
    exported = export_network(loaded, out, load_arrays(data, SYSTEMS[system], workers) if data else None)
    size = exported.network.stat().st_size / 1e6
    echo(
        f"{exported.network}  {size:.2f} MB, differs from PyTorch by {1e3 * exported.difference:.3f} mm at most, by"
        f" {1e3 * exported.rounding:.3f} mm before its weights were rounded\n"
        f"`eval --agent {system} --agent-config FILE` drives with it, FILE holds"
        f" {json.dumps({'weights': str(exported.network)})}"
    )


command = click.Group(
    "learn",
    help="Train systems that see through cameras, and detectors that share: data, training, evaluation, export.",
)
command.add_command(data_command)
command.add_command(demonstrations_command)
command.add_command(scans_command)
command.add_command(train_command)
command.add_command(evaluate_command)
command.add_command(export_command)
command.add_command(train_detector_command)
command.add_command(export_detector_command)
command.add_command(evaluate_detectors_command)
command.add_command(situations_command)
command.add_command(dialogues_command)
command.add_command(train_negotiator_command)
command.add_command(export_negotiator_command)
command.add_command(evaluate_negotiator_command)
command.add_command(observation_command)
