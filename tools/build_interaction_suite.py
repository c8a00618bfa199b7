"""Build the shipped `interaction` suite: `python -m tools.build_interaction_suite FOLDER [--dry-run]`.

For every category a pool of valid scenarios is searched, and those are kept whose means match the paper. The selection
of a category is stored in FOLDER.work when it is complete, so that an interrupted search continues. The suite keeps the
recipes, so that `mdrive-sumo generate --rebuild interaction` needs no search.
"""

import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click

from mdrive_sumo.core.terminal import echo
from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.generated_suite import check_output_folder, write_generated_suite
from mdrive_sumo.generate.generation_search import WEATHER, GenerationRequest, search_scenarios
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import Recipe, load_recipe, save_recipe
from mdrive_sumo.generate.selection import select_scenarios
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import SuiteFile
from tools.tool_command import HELP, ToolCommand, dry_run_option

ABOUT = SuiteFile(
    name="interaction",
    title="MDrive-Interaction-like suite",
    description="112 scenarios of our own making in the paper's eleven categories, with the paper's means.",
)
POOL_FACTOR = 3.0
"""Scenarios in the pool per scenario that is kept."""
OCCLUSION_CATEGORIES = frozenset((Category.PRE_CRASH, Category.CROSSWALK))
"""Categories in which only scenarios with an occlusion certificate are kept."""
TOWARDS_BUCKET = (1.018, 0.975)
"""Factors on routes and heading changes: the paper's figures of the bucket (91.3 m, 55.4 deg) are not the means of its
own table of categories (88.1 m, 58.4 deg; protocol 1.1). These factors meet both within tolerance.
"""
WORKERS = 2
LIMIT_S = 3600.0


@dataclass(frozen=True, slots=True)
class CategoryTask:
    """A category and the number of its scenarios to keep."""

    category: Category
    count: int


BuiltScenario = tuple[Recipe, Scenario]


def select_recipes(task: CategoryTask) -> list[Recipe]:
    """Return the numbered recipes of a category's scenarios, with weather."""
    pool = list(_search_pool(task))
    figures = CATEGORIES[task.category].paper
    assert figures is not None
    wanted = replace(
        figures,
        route_m=figures.route_m * TOWARDS_BUCKET[0],
        heading_change_deg=figures.heading_change_deg * TOWARDS_BUCKET[1],
    )
    kept = select_scenarios([scenario for _, scenario in pool], wanted, task.count, random.Random(task.category))
    recipes = {scenario.id: recipe for recipe, scenario in pool}
    return [_number_recipe(recipes[scenario.id], k) for k, scenario in enumerate(kept)]


def _search_pool(task: CategoryTask) -> Iterator[BuiltScenario]:
    order = GenerationRequest(
        task.category, round(task.count * POOL_FACTOR * (1.4 if task.category in OCCLUSION_CATEGORIES else 1.0))
    )
    for attempt in search_scenarios(order):
        if attempt.scenario is None or attempt.recipe is None or attempt.screening is None:
            continue
        if task.category not in OCCLUSION_CATEGORIES or attempt.screening.is_occluded:
            yield attempt.recipe, attempt.scenario


def _number_recipe(recipe: Recipe, k: int) -> Recipe:
    return recipe.model_copy(
        update={"id": f"{recipe.proposal.category}_{k + 1:02d}", "weather": WEATHER[k % len(WEATHER)]}
    )


def list_tasks() -> list[CategoryTask]:
    """Return the paper's categories with the number of their scenarios."""
    return [CategoryTask(name, facts.paper.count) for name, facts in CATEGORIES.items() if facts.paper is not None]


def build_interaction_suite(folder: Path) -> None:
    """Search and write the whole suite; raise RuntimeError if a category fails, InputError."""
    check_output_folder(folder)
    work = folder.with_name(f"{folder.name}.work")
    tasks = list_tasks()
    with ProcessPool[CategoryTask, list[Recipe]](select_recipes, WORKERS, LIMIT_S) as pool:
        for task, found in pool.run([task for task in tasks if not (work / task.category).is_dir()]):
            if isinstance(found, WorkerFailure):
                raise RuntimeError(f"{task.category}: {found.reason}")
            for recipe in found:
                save_recipe(recipe, work / task.category / f"{recipe.id}.json")
            echo(f"{task.category}: {len(found)}")
    recipes = [load_recipe(path) for task in tasks for path in sorted((work / task.category).iterdir())]
    write_generated_suite(ABOUT, [(recipe, build_scenario(recipe)) for recipe in recipes], folder)


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@dry_run_option
def main(folder: Path, dry_run: bool) -> None:
    """Search the suite `interaction` and write it to the new or empty FOLDER; takes half an hour."""
    if not dry_run:
        build_interaction_suite(folder)
        return
    check_output_folder(folder)
    for task in list_tasks():
        echo(f"{task.category}: {task.count} scenarios would be searched")


if __name__ == "__main__":
    # A worker cannot import a function of `__main__`: the search is that of the module of this name.
    from tools.build_interaction_suite import main as command

    command()
