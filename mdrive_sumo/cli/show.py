"""`mdrive-sumo show`."""

from pathlib import Path

import click

from mdrive_sumo.cli.choice import the_one
from mdrive_sumo.errors import InputError
from mdrive_sumo.report.picture import draw_scenario
from mdrive_sumo.roads import load, network_folder
from mdrive_sumo.scenario.catalog import load_suite


@click.command("show")
@click.argument("scenario")
@click.option("--suite", default="interdrive", show_default=True, help="Packaged suite, or a suite's folder.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Picture [default: SCENARIO.png].")
def command(scenario: str, suite: str, out: Path | None) -> None:
    """Draw a scenario: network, buildings, signs, CAVs with routes and goals, background traffic.

    SCENARIO is an id, or a glob that fits exactly one. The ending of --out (.png, .svg, .pdf) is the format.
    """
    loaded = load_suite(suite)
    chosen = the_one(loaded, scenario)
    path = out or Path(f"{chosen.id}.png")
    try:
        draw_scenario(chosen, load(network_folder(chosen.network, beside=loaded.folder)), path)
    except (OSError, ValueError) as error:  # ValueError: matplotlib does not know the ending
        raise InputError(f"{path}: cannot be written: {error}") from None
    click.echo(path)
