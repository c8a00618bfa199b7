"""Build a suite in which a CAV has the road to itself, to measure whether a learned system can follow its route.

    python -m tools.build_lone_suite OUT [--suite mdrive@0]

Each scenario keeps the CAV that comes first in it, and its weather, lights and stop signs; other CAVs, background
traffic, scripted road users, props and roadside units are removed.
"""

import shutil
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, Suite, SuiteFile, load_suite, save_suite
from tools.tool_command import HELP, ToolCommand, dry_run_option


def build_lone_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with its first CAV alone on the road."""
    return scenario.derive(egos=scenario.egos[:1], background=Background(), actors=(), rsus=())


def check_new(folder: Path) -> None:
    """Raise InputError if the folder exists."""
    if folder.exists():
        raise InputError(f"{folder}: expected a folder that does not exist yet, found one")


def write_lone_suite(name: str, folder: Path) -> Suite:
    """Write and return the suite of a suite's scenarios with one CAV each. Raises InputError if the folder exists."""
    check_new(folder)
    suite = load_suite(name)
    about = SuiteFile(name="lone", title=f"Scenarios of {suite.name}, each with its first CAV alone on the road")
    lone = Suite(about, folder, tuple(build_lone_scenario(one) for one in suite.scenarios))
    save_suite(lone)
    for network in {suite.find_folder(one.id) / NETWORKS_FOLDER / one.network for one in suite.scenarios}:
        if network.is_dir():  # a network of the suite's own; the others are packaged
            shutil.copytree(network, folder / NETWORKS_FOLDER / network.name)
    return lone


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--suite", default="mdrive", show_default=True, help="Suite whose scenarios are taken.")
@dry_run_option
def main(out: Path, suite: str, dry_run: bool) -> None:
    """Write a suite to the new folder OUT in which each scenario has its first CAV alone on the road."""
    if dry_run:
        check_new(out)
        echo(f"{out}: {len(load_suite(suite))} scenarios would be written")
        return
    echo(f"{out}: {len(write_lone_suite(suite, out))} scenarios")


if __name__ == "__main__":
    main()
