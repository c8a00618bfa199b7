"""Build a suite in which a CAV has the road to itself, to measure whether a learned system can follow its route.

    python -m tools.build_lone_suite OUT [--suite mdrive]

Each scenario keeps the CAV that comes first in it, and its weather, lights and stop signs; other CAVs, background
traffic, scripted road users, props and roadside units are removed.
"""

import argparse
import shutil
import sys
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, Suite, SuiteFile, load_suite, save_suite


def build_lone_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with its first CAV alone on the road."""
    return scenario.derive(egos=scenario.egos[:1], background=Background(), actors=(), rsus=())


def write_lone_suite(name: str, folder: Path) -> Suite:
    """Write and return the suite of a suite's scenarios with one CAV each. Raises InputError if the folder exists."""
    if folder.exists():
        raise InputError(f"{folder}: expected a folder that does not exist yet, found one")
    suite = load_suite(name)
    about = SuiteFile(name="lone", title=f"Scenarios of {suite.name}, each with its first CAV alone on the road")
    lone = Suite(about, folder, tuple(build_lone_scenario(one) for one in suite.scenarios))
    save_suite(lone)
    for network in {suite.find_folder(one.id) / NETWORKS_FOLDER / one.network for one in suite.scenarios}:
        if network.is_dir():  # a network of the suite's own; the others are packaged
            shutil.copytree(network, folder / NETWORKS_FOLDER / network.name)
    return lone


def main() -> None:
    """Write the suite."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--suite", default="mdrive")
    arguments = parser.parse_args()
    try:
        suite = write_lone_suite(arguments.suite, arguments.out)
    except InputError as error:
        raise SystemExit(f"Error: {error}") from None
    sys.stdout.write(f"{arguments.out}: {len(suite)} scenarios\n")


if __name__ == "__main__":
    main()
