"""Write a scenario with its network into a suite folder that `mdrive-sumo eval --suite` runs."""

from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file, make_folder, write_text
from mdrive_sumo.roads import RoadMap, list_packaged_networks
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, read_network_file
from mdrive_sumo.scenario.scenario import Scenario, save_scenario
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, SCENARIO_FILE, SUITE_FILE, SuiteFile, load_suite


def save_in_suite(scenario: Scenario, roads: RoadMap, folder: Path) -> Path:
    """Write a scenario into a suite folder, which is made if need be; a scenario of the same id is replaced.

    A network that is not a packaged one is copied into the folder. Raises InputError for a folder of something else, a
    sealed suite, or one that has another network of that name.
    """
    try:
        if (folder / SUITE_FILE).exists():
            _check_suite(folder)
        elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: expected a suite's folder, or a new or empty one, found something else there")
        make_folder(folder)
        _copy_network(roads, folder / NETWORKS_FOLDER / roads.name)
        if not (folder / SUITE_FILE).exists():
            about = SuiteFile(name=folder.resolve().name, title=folder.resolve().name)
            write_text(folder / SUITE_FILE, about.model_dump_json(indent=2) + "\n")
        save_scenario(scenario, folder / scenario.id / SCENARIO_FILE)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    return folder


def _check_suite(folder: Path) -> None:
    suite = load_suite(str(folder))
    if suite.about.checksum or suite.parts:
        kind = "a sealed suite" if suite.about.checksum else "one made of other suites"
        raise InputError(f"{folder}: expected a suite that may grow, found {kind}; save into a new folder")


def _copy_network(roads: RoadMap, target: Path) -> None:
    packaged = list_packaged_networks().get(roads.name)
    if packaged is not None and packaged.resolve() == roads.folder.resolve():
        return
    if (target / NETWORK_FILE).exists():
        if read_network_file(target) != read_network_file(roads.folder):
            raise InputError(
                f"{target}: expected the network {roads.name} of this scenario, found another one of its name;"
                " `convert network --name` gives a network another name"
            )
        return
    make_folder(target)
    for name in (NET_FILE, NETWORK_FILE):
        copy_file(roads.folder / name, target / name)
