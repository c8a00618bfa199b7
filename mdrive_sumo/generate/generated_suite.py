"""Suites of generated scenarios: written with a recipe beside each scenario, and rebuilt from the recipes."""

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import copy_file, make_folder, make_parents
from mdrive_sumo.generate.drawn_places import redraw_network
from mdrive_sumo.generate.hard.hard_recipe import HardRecipe, build_hard_scenario, is_hard_recipe, load_hard_recipe
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import Recipe, load_recipe, save_recipe
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.scenario.packaged_suites import find_suite_folder, list_exact_suites
from mdrive_sumo.scenario.reference_times import REFERENCE_TIMES_FILE
from mdrive_sumo.scenario.scenario import Scenario, save_scenario
from mdrive_sumo.scenario.suite import (
    NETWORKS_FOLDER,
    RECIPE_FILE,
    SCENARIO_FILE,
    Suite,
    SuiteFile,
    load_suite,
    natural_sort_key,
    save_suite,
    seal_suite,
)
from mdrive_sumo.study.need_certificate import NEED_FILE
from mdrive_sumo.study.occlusion_certificate import CERTIFICATE_FILE

AnyRecipe = Recipe | HardRecipe
MEASURED_FILES = (CERTIFICATE_FILE, NEED_FILE, REFERENCE_TIMES_FILE)
"""Files beside a suite that hold what drives showed."""


def check_output_folder(folder: Path) -> None:
    """Raise InputError unless the folder is new or empty and can be written."""
    with report_write_errors(folder):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder}: expected a new or empty folder to write to, found something there")
        make_parents(folder)
        with tempfile.TemporaryDirectory(dir=folder.parent):
            return


def write_generated_suite(
    about: SuiteFile,
    made: Iterable[tuple[AnyRecipe, Scenario]],
    folder: Path,
    add_files: Callable[[Suite], object] | None = None,
    networks: Mapping[str, Path] | None = None,
) -> Suite:
    """Write a sealed suite and its recipes; the folder appears when everything is written. Raises InputError.

    add_files: writes further files beside the sealed suite. networks: folders of networks of its own, by name.
    """
    check_output_folder(folder)
    pairs = list(made)
    with (
        report_write_errors(folder),
        tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as scratch,
    ):
        draft = Path(scratch) / "suite"
        for name, network in (networks or {}).items():
            _copy_network(network, draft / NETWORKS_FOLDER / name)
        save_suite(Suite(about.model_copy(update={"checksum": ""}), draft, tuple(one for _, one in pairs)))
        sealed = seal_suite(load_suite(str(draft)))  # of what is read again: files hold rounded numbers
        save_suite(sealed)
        for recipe, scenario in pairs:
            save_recipe(recipe, draft / scenario.id / RECIPE_FILE)
        if add_files is not None:
            add_files(sealed)
        if folder.exists():
            folder.rmdir()
        draft.rename(folder)
    return load_suite(str(folder))


def _copy_network(network: Path, folder: Path) -> None:
    for path in sorted(network.iterdir()):
        copy_file(path, make_folder(folder) / path.name)


def load_recipes(name_or_folder: str) -> dict[Path, AnyRecipe]:
    """Return, by scenario folder, the recipes of a packaged suite or one on disk; raises InputError where one is
    missing.

    The scenarios are not read: a suite that was changed since and cannot be loaded can be rebuilt.
    """
    folder = find_suite_folder(name_or_folder)
    homes = {path.parent for file in (SCENARIO_FILE, RECIPE_FILE) for path in folder.glob(f"*/{file}")}
    if not homes:
        raise InputError(f"suite {name_or_folder!r}: expected scenarios with recipes in <id>/{RECIPE_FILE}, found none")
    return {
        home: _load_any_recipe(home / RECIPE_FILE)
        for home in sorted(homes, key=lambda home: natural_sort_key(home.name))
    }


def _load_any_recipe(path: Path) -> AnyRecipe:
    return load_hard_recipe(path) if is_hard_recipe(path) else load_recipe(path)


def rebuild_scenario(recipe: AnyRecipe, networks: Path) -> Scenario:
    """Return the scenario of a recipe, its place drawn into a folder below `networks` if it has one; raises InputError
    where this generator rejects it."""
    try:
        roads = redraw_network(recipe.place, networks) if recipe.place is not None else None
        if isinstance(recipe, HardRecipe):
            assert roads is not None, "every recipe of the hard tier has a place"
            return build_hard_scenario(recipe, roads)
        return build_scenario(recipe, roads=roads)
    except ProposalRejected as refused:
        raise InputError(f"recipe {recipe.id}: refused at stage {refused.stage}: {refused.reason}") from None


def write_rebuilt_suite(suite: Suite, recipes: Mapping[Path, AnyRecipe], folder: Path) -> Suite:
    """Write the scenarios that the recipes of a suite make as a new suite. Raises InputError.

    What was measured, which no recipe makes again, is copied if the scenarios are the same.
    """

    def copy_measured(sealed: Suite) -> None:
        if sealed.checksum() == suite.checksum():
            for path in (suite.folder / name for name in MEASURED_FILES):
                if path.is_file():
                    copy_file(path, sealed.folder / path.name)

    with tempfile.TemporaryDirectory() as scratch:
        made = [(recipe, rebuild_scenario(recipe, Path(scratch))) for recipe in recipes.values()]
        networks = {path.name: path for path in Path(scratch).iterdir()}
        return write_generated_suite(suite.about, made, folder, copy_measured, networks)


def find_rebuild_differences(recipes: Mapping[Path, AnyRecipe]) -> Iterator[str]:
    """Return the names of scenario folders whose file, or whose network, is missing or differs from the rebuilt one,
    byte for byte."""
    with tempfile.TemporaryDirectory() as scratch:
        networks, again = Path(scratch) / NETWORKS_FOLDER, Path(scratch) / SCENARIO_FILE
        for home, recipe in recipes.items():
            scenario = rebuild_scenario(recipe, networks)
            save_scenario(scenario, again)
            drawn = [path.relative_to(scratch) for path in sorted(networks.glob(f"{scenario.network}/*"))]
            pairs = [(again, home / SCENARIO_FILE), *((Path(scratch) / path, home.parent / path) for path in drawn)]
            if not all(found.is_file() and read_bytes(made) == read_bytes(found) for made, found in pairs):
                yield home.name


def load_packaged_generated() -> tuple[Scenario, ...]:
    """Return the scenarios of all packaged suites of all seasons that have recipes."""
    folders = [folder for folder in list_exact_suites().values() if any(folder.glob(f"*/{RECIPE_FILE}"))]
    return tuple(scenario for folder in folders for scenario in load_suite(str(folder)).scenarios)
