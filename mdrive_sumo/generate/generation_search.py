"""Search: proposals are drawn one after another until enough of them have become scenarios."""

import hashlib
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from mdrive_sumo.generate import template_proposer
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.pipeline import ProposalRejected, build_scenario, screen_candidate
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import GENERATOR, Recipe
from mdrive_sumo.generate.screening import ScreeningResult
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import WeatherName

TRIES = 15
"""Proposals for every scenario wanted, on average, before the search gives up."""
WEATHER: tuple[WeatherName, ...] = (
    "cloudy", "night", "default", "rain", "cloudy", "night", "cloudy", "night", "default", "rain",
)  # fmt: skip
"""Of every ten scenarios 3 cloudy, 3 night, 2 default, 2 rain (paper, "Scenario Description")."""
Proposer = Callable[[Category, str], Proposal]
"""Category and seed -> proposal; raises Rejected where it has none."""


@dataclass(frozen=True, slots=True)
class GenerationRequest:
    """What is to be generated."""

    category: Category
    count: int
    seed: int = 0
    split: Literal["public", "hidden"] = "public"
    secret: str = ""
    """What only the organiser of a hidden split knows; mixed into every seed."""

    def attempt_seed(self, number: int) -> str:
        """Seed of the attempt with that number; it tells nothing about the secret."""
        text = "/".join((str(GENERATOR), self.split, self.secret, self.category, str(self.seed), str(number)))
        return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()

    def scenario_id(self, number: int) -> str:
        """Id of the scenario that attempt makes; no hidden one has the id of a public one."""
        return f"{self.category}_{'h' if self.split == 'hidden' else ''}{self.attempt_seed(number)[:8]}"


@dataclass(frozen=True, slots=True)
class GenerationAttempt:
    """What became of one proposal: a scenario, or the stage that refused it and why."""

    number: int
    recipe: Recipe | None
    scenario: Scenario | None
    screening: ScreeningResult | None
    rejection: tuple[str, str] | None = None
    """Stage and reason."""


def propose_from_template(category: Category, seed: str) -> Proposal:
    """The proposer that needs nothing."""
    return template_proposer.propose(category, random.Random(f"{seed}/proposal"))


def search_scenarios(
    order: GenerationRequest,
    proposer: Proposer = propose_from_template,
    known: Sequence[Scenario] = (),
    name: str = "template",
) -> Iterator[GenerationAttempt]:
    """Attempts until `count` scenarios are found, none like those `known`; gives up after `TRIES` for each."""
    accepted: list[Scenario] = []
    for number in range(order.count * TRIES):
        if len(accepted) == order.count:
            return
        attempt = _attempt(order, number, (proposer, name), accepted, known)
        if attempt.scenario is not None:
            accepted.append(attempt.scenario)
        yield attempt


def _attempt(
    order: GenerationRequest,
    number: int,
    by: tuple[Proposer, str],
    accepted: Sequence[Scenario],
    known: Sequence[Scenario],
) -> GenerationAttempt:
    recipe: Recipe | None = None
    try:
        recipe = _recipe(order, number, by, WEATHER[len(accepted) % len(WEATHER)])
        scenario = build_scenario(recipe)
        return GenerationAttempt(number, recipe, scenario, screen_candidate(scenario, [*known, *accepted]))
    except ProposalRejected as refused:
        return GenerationAttempt(number, recipe, None, None, (refused.stage, refused.reason))


def _recipe(
    order: GenerationRequest, number: int, by: tuple[Proposer, str], weather: WeatherName = "default"
) -> Recipe:
    seed = order.attempt_seed(number)
    proposal = by[0](order.category, seed)
    return Recipe(id=order.scenario_id(number), seed=seed, proposer=by[1], weather=weather, proposal=proposal)


def build_public_counterparts(order: GenerationRequest) -> Iterator[Scenario]:
    """All scenarios of which the public split with the same seed is made by templates; none is driven."""
    public = replace(order, split="public", secret="")
    for number in range(order.count * TRIES):
        try:
            yield build_scenario(_recipe(public, number, (propose_from_template, "template")))
        except ProposalRejected:
            continue
