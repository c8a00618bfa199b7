"""SeasonCandidate: one proposal on a place of its own, built, screened and kept in the work folder of a season."""

import random
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from mdrive_sumo.core.output_files import copy_file, make_folder
from mdrive_sumo.generate.category_requirements import find_requirements
from mdrive_sumo.generate.drawn_places import draw_fitting_network, list_choices
from mdrive_sumo.generate.interdrive_proposer import propose_interdrive
from mdrive_sumo.generate.network_choice import is_suitable
from mdrive_sumo.generate.pipeline import build_scenario, screen_candidate
from mdrive_sumo.generate.pre_crash_typologies import (
    draft_pre_crash_at_signals,
    draft_pre_crash_without_signals,
)
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import SEASON_GENERATOR, Recipe, save_recipe
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.generate.seasons.season_plan import SeasonGroup
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed
from mdrive_sumo.generate.selection import SelectionItem, build_item
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.generate.validation.rule_coverage import find_exercised_rules
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.scenario.categories import Category, InterDriveCategory
from mdrive_sumo.scenario.packaged_suites import list_exact_suites
from mdrive_sumo.scenario.scenario import Scenario, save_scenario
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, load_suite

RECIPES_FOLDER, SCENARIOS_FOLDER = "recipes", "scenarios"


@dataclass(frozen=True, slots=True)
class SeasonTask:
    """A candidate to evaluate; plain values, so that it can be sent to a worker process."""

    seed: SeasonSeed
    group: SeasonGroup
    number: int
    work: Path
    """Folder in which an accepted candidate's files are kept."""

    @property
    def key(self) -> str:
        """Return the name of the candidate in the journal."""
        return f"{self.group.bucket}/{self.group.name}/{self.number}"


@dataclass(frozen=True, slots=True)
class SeasonOutcome:
    """Result of a candidate: its figures, or the stage that rejected it and why."""

    key: str
    item: SelectionItem | None
    stage: str = ""
    reason: str = ""

    def to_line(self) -> dict[str, Any]:
        """Return what the journal holds."""
        figures = None if self.item is None else asdict(self.item)
        return {"id": self.key, "item": figures, "stage": self.stage, "reason": self.reason}


def read_outcome(line: Mapping[str, Any]) -> SeasonOutcome:
    """Return the outcome that a line of the journal holds."""
    item = None if line["item"] is None else SelectionItem(**line["item"])
    return SeasonOutcome(line["id"], item, line["stage"], line["reason"])


def evaluate_candidate(task: SeasonTask) -> SeasonOutcome:
    """Propose, draw a place, build and screen; keep the files of an accepted scenario in the work folder.

    Raises InputError without netconvert.
    """
    seed = task.seed.derive(task.group.bucket, task.group.name, task.number)
    proposal = _propose(task.group, seed)
    make_folder(task.work)
    with tempfile.TemporaryDirectory(dir=task.work, prefix=".place-") as scratch:
        try:
            item = _evaluate_on_place(task, seed, proposal, Path(scratch))
        except ProposalRejected as refused:
            return SeasonOutcome(task.key, None, refused.stage, refused.reason[:300])
    return SeasonOutcome(task.key, item)


def _propose(group: SeasonGroup, seed: str) -> Proposal:
    rng = random.Random(f"{seed}/proposal")
    if isinstance(group.category, InterDriveCategory):
        topology = rng.choice(find_requirements(group.category).road.topologies)
        return propose_interdrive(group.category, group.cavs, topology, rng)
    if group.category is Category.PRE_CRASH:
        draft = draft_pre_crash_at_signals if group.at_signals else draft_pre_crash_without_signals
        return propose(group.category, rng, draft)
    return propose(group.category, rng)


def _evaluate_on_place(task: SeasonTask, seed: str, proposal: Proposal, scratch: Path) -> SelectionItem:
    choices = list_choices(proposal, at_signals=task.group.at_signals)
    about, roads = draw_fitting_network(choices, lambda features: is_suitable(features, proposal), seed, scratch)
    recipe = Recipe(
        generator=SEASON_GENERATOR,
        id=f"{task.group.category}_{seed[:8]}",
        seed=seed,
        proposer="interdrive" if task.group.cavs else "template",
        proposal=proposal,
        signals="program" if task.group.at_signals else "frozen-green",
        place=about,
    )
    scenario = build_scenario(recipe, roads=roads)
    if task.group.at_signals and "red-light" not in find_exercised_rules(scenario, roads):
        raise ProposalRejected(PipelineStage.WAYS, "expected a route past signals, found none")
    known = _list_known(scenario.network) if scenario.network in list_packaged_networks() else ()
    found = screen_candidate(scenario, known, roads)
    if task.group.must_be_occluded and not found.is_occluded:
        raise ProposalRejected(PipelineStage.DIFFICULTY, "expected a road user hidden before a conflict, found none")
    _keep_files(task.work, recipe, scenario, roads.folder)
    return build_item(scenario, task.group.name, is_hidden=found.is_occluded)


@lru_cache(maxsize=64)
def _list_known(network: str) -> tuple[Scenario, ...]:
    """Return the scenarios of all packaged seasons on a packaged network: on others there can be no duplicate."""
    suites = {folder: load_suite(name) for name, folder in list_exact_suites().items()}
    return tuple(one for suite in suites.values() if not suite.parts for one in suite if one.network == network)


def _keep_files(work: Path, recipe: Recipe, scenario: Scenario, network: Path) -> None:
    save_scenario(scenario, work / SCENARIOS_FOLDER / f"{scenario.id}.json")
    save_recipe(recipe, work / RECIPES_FOLDER / f"{recipe.id}.json")
    home = make_folder(work / NETWORKS_FOLDER / scenario.network)
    for path in sorted(network.iterdir()):
        copy_file(path, home / path.name)
