"""Write the built-in `interdrive` suite from its recipe: `python -m tools.build_interdrive_suite [--dry-run]`.

The recipe (`scenarios/interdrive/recipe.toml`) says for every CAV which lanes it takes, in the notation of
`mdrive_sumo.worlds.authoring.route_steps`.
"""

import tempfile
import tomllib
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.packaged_suites import list_seasons
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite, seal_suite
from mdrive_sumo.worlds.authoring.route_steps import build_route
from mdrive_sumo.worlds.placement.cavs import build_ego
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files

RECIPE_FILE = "recipe.toml"
BUCKET = "InterDrive"


def build_scenario(entry: dict[str, Any]) -> Scenario:
    """Build a scenario from its table of the recipe; raise InputError."""
    roads = load_road_map(find_network_folder(entry["network"]))
    try:
        egos = tuple(build_ego(str(i), build_route(roads, text)) for i, text in enumerate(entry["cavs"]))
    except InputError as error:
        raise InputError(f"{entry['id']}: {error}") from None
    return Scenario(
        id=entry["id"],
        bucket=BUCKET,
        category=entry["category"],
        network=entry["network"],
        description=entry["description"],
        signals=entry.get("signals", "frozen-green"),
        egos=egos,
    )


def build_suite(folder: Path) -> Suite:
    """Build the suite described by the recipe in `folder`."""
    recipe = tomllib.loads((folder / RECIPE_FILE).read_text())
    return Suite(SuiteFile(**recipe["suite"]), folder, tuple(build_scenario(entry) for entry in recipe["scenario"]))


def write_suite(folder: Path) -> Suite:
    """Write and seal `suite.json` and every `scenario.json` of the recipe in `folder`."""
    save_suite(build_suite(folder))
    suite = seal_suite(load_suite(str(folder)))  # seal the rounded values of the files
    save_suite(suite)
    return suite


@click.command(cls=ToolCommand, context_settings=HELP)
@dry_run_option
def main(dry_run: bool) -> None:
    """Write the packaged suite `interdrive` anew from its recipe, `recipe.toml` in its folder."""
    folder = list_seasons("interdrive")[0]
    with tempfile.TemporaryDirectory() as scratch:
        copy_file(folder / RECIPE_FILE, Path(scratch, RECIPE_FILE))
        write_suite(Path(scratch))
        replace_changed_files(Path(scratch), folder, dry_run=dry_run)


if __name__ == "__main__":
    main()
