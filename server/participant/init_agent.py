"""`mdrive-sumo init-agent`: write a working sample agent."""

import shutil
from importlib.resources import as_file, files
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo

STYLES = ("agent", "joint", "lidar")


@click.command("init-agent")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option(
    "--style",
    type=click.Choice(STYLES),
    default=STYLES[0],
    show_default=True,
    help=(
        "agent: one object per CAV; joint: one program for all CAVs, as in the CARLA leaderboard; lidar: one object per"
        " CAV in the sensor track, without lists of objects."
    ),
)
def init_agent(folder: Path, style: str) -> None:
    """Write a working sample agent as a starting point.

    DIR must be empty or not exist. Next step: mdrive-sumo check DIR.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: expected an empty or new folder, found one with files")
    try:
        with as_file(files("server") / "samples" / style) as sample:
            shutil.copytree(sample, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    echo(f"{folder}: sample agent written; next: mdrive-sumo check {folder}")
