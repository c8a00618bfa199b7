"""`mdrive-sumo learn export`."""

from pathlib import Path

import click

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.learning.require_torch import require_torch


@click.command("export")
@click.argument("system", type=click.Choice(tuple(SYSTEMS)))
@click.option("--checkpoint", type=click.Path(path_type=Path), required=True, help="checkpoint.pt of `learn train`.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder for the files.")
def command(system: str, checkpoint: Path, out: Path) -> None:
    """Write SYSTEM.onnx (weights in half precision) and SYSTEM.json, and check its plans against PyTorch's.

    Needs the extras `learn` and `learned`.
    """
    require_torch("learn export", "onnxruntime")
    from mdrive_sumo.learning.training.checkpoint import load_checkpoint
    from mdrive_sumo.learning.training.export_network import export_network

    found = export_network(load_checkpoint(checkpoint, system), out)
    size = found.network.stat().st_size / 1e6
    click.echo(f"{found.network}  {size:.2f} MB, differs from PyTorch by {1e3 * found.difference:.3f} mm at most")
