"""The option `--workers`, which imports no simulator."""

import click

from mdrive_sumo.core.posix import check_posix


def parse_worker_count(_: click.Context, __: click.Parameter, value: str) -> int:
    """Return the value of --workers: a positive number; "auto" is every core that this process may use."""
    if value == "auto":
        from mdrive_sumo.runs.process_pool import (
            count_available_cores,  # here, so that `convert --help` need not import it
        )

        return count_available_cores()
    if not value.isdecimal() or int(value) < 1:
        raise click.BadParameter(f"expected a positive number or auto, found {value!r}")
    if int(value) > 1:
        check_posix(f"--workers {value}: more than one worker")
    return int(value)


workers_option = click.option(
    "--workers",
    default="auto",
    show_default=True,
    metavar="N|auto",
    callback=parse_worker_count,
    help="Worker processes; auto: one a core.",
)
