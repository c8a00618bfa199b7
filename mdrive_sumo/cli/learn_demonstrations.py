"""`mdrive-sumo learn demonstrations`."""

from pathlib import Path

import click

from mdrive_sumo.cli.learn_data import CollectionDisplay, format_dataset
from mdrive_sumo.cli.stored_run_options import moved_suite_option
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.recorded_rigs import RIG_NAMES, parse_rig_names


@click.command("demonstrations")
@click.argument("folder", metavar="TAKES", type=click.Path(path_type=Path))
@click.option("--rig", "rigs", multiple=True, metavar="|".join(RIG_NAMES), help="Cameras to record; may repeat.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, help="New or empty folder.")
@moved_suite_option
def command(folder: Path, rigs: tuple[str, ...], out: Path, suite: str | None) -> None:
    """Make training data of takes: what a learner sees where a person drives, with what the person did.

    TAKES is a take or a folder that holds takes. Every take is driven again, and refused unless it is the recorded one.
    """
    from mdrive_sumo.export.demonstrations import load_takes
    from mdrive_sumo.learning.demonstrated_drives import collect_demonstrations

    takes = load_takes(folder, suite)
    display = CollectionDisplay()
    display.begin(len(takes), 0)
    dataset = collect_demonstrations(takes, parse_rig_names(rigs), out, display)
    echo(format_dataset(dataset))
    echo(f"{out}  {len(dataset.shards)} shards and dataset.json")
