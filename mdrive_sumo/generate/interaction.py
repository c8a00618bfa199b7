"""Writes the built-in `interaction` suite anew: `python -m mdrive_sumo.generate.interaction [FOLDER]`.

For every category a pool of good scenarios is searched, of which those are kept whose means are the paper's. The suite
keeps the recipes, so that `mdrive-sumo generate --rebuild interaction` needs no search.
"""

import random
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.generate.category import CATEGORIES, Category
from mdrive_sumo.generate.pipeline import built
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.search import WEATHER, Order, search
from mdrive_sumo.generate.select import selected
from mdrive_sumo.generate.suite import write_generated
from mdrive_sumo.scenario.catalog import SuiteFile
from mdrive_sumo.scenario.spec import Scenario
from mdrive_sumo.suite.pool import Pool, WorkerFailure

ABOUT = SuiteFile(
    name="interaction",
    title="MDrive-Interaction-like suite",
    description="112 scenarios of our own making in the paper's eleven categories, with the paper's means.",
)
POOL = 3.0
"""Scenarios in the pool for every one that is kept."""
HIDDEN = frozenset((Category.PRE_CRASH, Category.CROSSWALK))
"""Categories in which only scenarios with an occlusion certificate are kept."""
WORKERS = 2
LIMIT_S = 3600.0


@dataclass(frozen=True, slots=True)
class Task:
    """A category and how many of its scenarios are kept."""

    category: Category
    count: int


Made = tuple[Recipe, Scenario]


def chosen(task: Task) -> list[Made]:
    """The scenarios of a category, numbered, with weather."""
    pool = list(_pool(task))
    figures = CATEGORIES[task.category].paper
    assert figures is not None
    kept = selected([scenario for _, scenario in pool], figures, task.count, random.Random(task.category))
    recipes = {scenario.id: recipe for recipe, scenario in pool}
    return [_numbered(recipes[scenario.id], k) for k, scenario in enumerate(kept)]


def _pool(task: Task) -> Iterator[Made]:
    order = Order(task.category, round(task.count * POOL * (1.4 if task.category in HIDDEN else 1.0)))
    for attempt in search(order):
        if attempt.scenario is None or attempt.recipe is None or attempt.screened is None:
            continue
        if task.category not in HIDDEN or attempt.screened.occluded:
            yield attempt.recipe, attempt.scenario


def _numbered(recipe: Recipe, k: int) -> Made:
    renamed = recipe.model_copy(
        update={"id": f"{recipe.proposal.category}_{k + 1:02d}", "weather": WEATHER[k % len(WEATHER)]}
    )
    return renamed, built(renamed)


def interaction(folder: Path) -> Sequence[Made]:
    """Searches and writes the whole suite; raises RuntimeError where a category fails."""
    tasks = [Task(name, facts.paper.count) for name, facts in CATEGORIES.items() if facts.paper is not None]
    found: dict[Category, list[Made]] = {}
    with Pool[Task, list[Made]](chosen, WORKERS, LIMIT_S) as pool:
        for task, made in pool.run(tasks):
            if isinstance(made, WorkerFailure):
                raise RuntimeError(f"{task.category}: {made.reason}")
            found[task.category] = made
            sys.stdout.write(f"{task.category}: {len(made)}\n")
            sys.stdout.flush()
    ordered = [made for task in tasks for made in found[task.category]]
    write_generated(ABOUT, ordered, folder)
    return ordered


def main(folders: list[str]) -> None:
    """Writes the suite to the named folder, or to its place in the package."""
    folder = Path(folders[0]) if folders else Path(__file__).parents[1] / "scenarios" / "interaction"
    interaction(folder)


if __name__ == "__main__":
    main(sys.argv[1:])
