"""`mdrive-sumo learn export`."""

import json
from pathlib import Path

import click

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.cli.workers import workers_option
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.require_torch import require_torch


@click.command("export")
@click.argument("system", type=click.Choice(tuple(SYSTEMS)))
@click.option("--checkpoint", type=click.Path(path_type=Path), required=True, help="checkpoint.pt of `learn train`.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the files.")
@click.option(
    "--data", multiple=True, type=click.Path(path_type=Path, file_okay=False), help="Compare on samples of it, too."
)
@workers_option
def command(system: str, checkpoint: Path, out: Path, data: tuple[Path, ...], workers: int) -> None:
    """Write SYSTEM.onnx (weights in half precision) and SYSTEM.json, and check its plans against PyTorch's.

    Needs the extras `learn` and `learned`.
    """
    require_torch("learn export", "onnxruntime")
    from mdrive_sumo.learning.sample_reader import load_arrays
    from mdrive_sumo.learning.training.checkpoint import load_checkpoint
    from mdrive_sumo.learning.training.export_network import export_network

    loaded = load_checkpoint(checkpoint, system)
    found = export_network(loaded, out, load_arrays(data, SYSTEMS[system], workers) if data else None)
    size = found.network.stat().st_size / 1e6
    echo(
        f"{found.network}  {size:.2f} MB, differs from PyTorch by {1e3 * found.difference:.3f} mm at most, by"
        f" {1e3 * found.rounding:.3f} mm before its weights were rounded\n"
        f"`eval --agent {system} --agent-config FILE` drives with it, FILE holds"
        f" {json.dumps({'weights': str(found.network)})}"
    )
