"""Suites of generated scenarios: written with the recipe beside each, and made again from the recipes."""

import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from mdrive_sumo.errors import InputError
from mdrive_sumo.generate.pipeline import Rejected, built
from mdrive_sumo.generate.recipe import RECIPE_FILE, Recipe, load_recipe, save_recipe
from mdrive_sumo.scenario.catalog import SCENARIO_FILE, Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scenario.spec import Scenario, save_scenario


def check_new(folder: Path) -> None:
    """Raises InputError unless the folder is new or empty."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: expected a new or empty folder to write to, found something there")


def write_generated(about: SuiteFile, made: Iterable[tuple[Recipe, Scenario]], folder: Path) -> Suite:
    """Writes scenarios and recipes; the folder appears only when everything is written. Raises InputError."""
    check_new(folder)
    pairs = list(made)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as scratch:
        draft = Path(scratch) / "suite"
        save_suite(Suite(about, draft, tuple(scenario for _, scenario in pairs)))
        for recipe, scenario in pairs:
            save_recipe(recipe, draft / scenario.id / RECIPE_FILE)
        if folder.exists():
            folder.rmdir()
        draft.rename(folder)
    return load_suite(str(folder))


def recipes_of(suite: Suite) -> tuple[Recipe, ...]:
    """Recipes of all scenarios of a suite; raises InputError where one is missing."""
    return tuple(load_recipe(suite.folder / scenario.id / RECIPE_FILE) for scenario in suite.scenarios)


def rebuilt(recipe: Recipe) -> Scenario:
    """The scenario of a recipe; raises InputError where this generator refuses it."""
    try:
        return built(recipe)
    except Rejected as refused:
        raise InputError(f"recipe {recipe.id}: refused at stage {refused.stage}: {refused.reason}") from None


def changed_by_rebuild(suite: Suite, recipes: Sequence[Recipe]) -> tuple[str, ...]:
    """Ids of scenarios whose files differ from what their recipes make, byte for byte."""
    changed: list[str] = []
    with tempfile.TemporaryDirectory() as scratch:
        for recipe in recipes:
            again = Path(scratch) / recipe.id / SCENARIO_FILE
            save_scenario(rebuilt(recipe), again)
            if again.read_bytes() != (suite.folder / recipe.id / SCENARIO_FILE).read_bytes():
                changed.append(recipe.id)
    return tuple(changed)
