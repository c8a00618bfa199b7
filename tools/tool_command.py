"""ToolCommand: what the commands of developers share, `python -m tools.NAME`."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import click
from PIL import Image

from mdrive_sumo.cli.command_line import InputProblem
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file, make_parents, write_bytes
from mdrive_sumo.core.terminal import echo

HELP = {"help_option_names": ["-h", "--help"]}

dry_run_option = click.option("--dry-run", is_flag=True, help="Say what would be written, and write nothing.")


PALETTE = 128
"""Colours of a drawn picture: a quarter of its size, and no difference to be seen."""


class ToolCommand(click.Command):
    """A command that ends with one sentence and exit code 2 for an InputError, as `mdrive-sumo` does."""

    def invoke(self, ctx: click.Context) -> object:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except InputError as error:
            raise InputProblem(str(error)) from None


def find_changed_files(built: Path, target: Path) -> list[Path]:
    """Return the files below `built`, relative to it, that `target` lacks or has with other bytes."""
    files = sorted(path.relative_to(built) for path in built.rglob("*") if path.is_file())
    return [name for name in files if not _is_same_file(built / name, target / name)]


def _is_same_file(path: Path, other: Path) -> bool:
    return other.is_file() and path.read_bytes() == other.read_bytes()


def replace_changed_files(built: Path, target: Path, *, dry_run: bool) -> Sequence[Path]:
    """Copy the files below `built` that differ to `target`, print their names, and return them.

    built: folder with new files. dry_run: only print.
    """
    changed = find_changed_files(built, target)
    for name in changed:
        if not dry_run:
            make_parents(target / name)
            copy_file(built / name, target / name)
        echo(f"{'would change' if dry_run else 'changed'}: {target / name}")
    echo(f"{target}: {len(changed)} files {'would change' if dry_run else 'changed'}")
    return changed


def write_small_picture(png: bytes, path: Path) -> None:
    """Write a picture with few colours, and print its path and size."""
    buffer = BytesIO()
    Image.open(BytesIO(png)).convert("RGB").quantize(PALETTE, dither=Image.Dither.NONE).save(
        buffer, "PNG", optimize=True
    )
    make_parents(path)
    write_bytes(path, buffer.getvalue())
    echo(f"{path} {len(buffer.getvalue())} bytes")
