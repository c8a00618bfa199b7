"""`mdrive-sumo export`."""

from pathlib import Path

import click

from mdrive_sumo.cli.stored_run_options import moved_suite_option
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.export.export_formats import list_export_formats


def _describe_formats() -> str:
    """Return the paragraph of the help text that lists the formats."""
    rows = [
        f"  {name:13} {entry.description}{' *' if entry.package else ''}"
        for name, entry in list_export_formats().items()
    ]
    return "\n".join(("\b", *rows, f"  * needs {format_installation('export')}"))


@click.command("export", epilog=_describe_formats())
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "format_name",
    type=click.Choice(tuple(list_export_formats())),
    required=True,
    help="What to write, see below.",
)
@click.option("--scenario", "patterns", multiple=True, metavar="GLOB", help="Only these; repeatable [default: all].")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="New or empty folder.")
@click.option(
    "--demonstrations",
    is_flag=True,
    help="Only what people did and were shown, as tables (csv, parquet); RUN: a take, or a folder of takes.",
)
@moved_suite_option
def command(
    run_folder: Path, format_name: str, patterns: tuple[str, ...], out: Path, demonstrations: bool, suite: str | None
) -> None:
    """Write recorded episodes in the formats of other tools.

    docs/export.md says for each format what is in it, in which frame and units, and which program opens it. Either
    everything is written or nothing is.

    With --demonstrations every take is driven again, to know what the person was shown.
    """
    from mdrive_sumo.export.demonstrations import export_demonstrations, load_takes
    from mdrive_sumo.export.export_run import export_runs
    from mdrive_sumo.runs.stored_run import load_stored_run

    if demonstrations:
        export_demonstrations(load_takes(run_folder, suite), format_name, out, patterns)
    else:
        export_runs([load_stored_run(run_folder, suite)], format_name, out, patterns)
    for path in sorted(out.iterdir()):
        echo(path)
