"""Compile the shipped networks from their recipes: `python -m tools.build_networks [NAME...]`.

The recipes are written by hand (networks/README.md).
"""

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from mdrive_sumo.roads import find_network_folder, list_packaged_networks
from mdrive_sumo.worlds.places.recipe import build_network
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("names", nargs=-1, metavar="[NAME]...")
@dry_run_option
def main(names: Sequence[str], dry_run: bool) -> None:
    """Compile the named packaged networks from their recipes, or all of them."""
    folders = [find_network_folder(name) for name in names or list_packaged_networks()]
    for folder in folders:
        with tempfile.TemporaryDirectory() as scratch:
            built = Path(scratch, folder.name)
            build_network(Path(shutil.copytree(folder, built)))
            replace_changed_files(built, folder, dry_run=dry_run)


if __name__ == "__main__":
    main()
