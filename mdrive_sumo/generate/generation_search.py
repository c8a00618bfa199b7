"""Draws proposals one after another until enough of them have become scenarios."""

import hashlib
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from mdrive_sumo.generate import template_proposer
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.pipeline import build_scenario, screen_candidate
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import GENERATOR, Recipe
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.generate.screening import ScreeningResult
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import WeatherName

MAX_TRIES = 15
"""Proposals per requested scenario, on average, before the search gives up."""
WEATHER: tuple[WeatherName, ...] = (
    "cloudy", "night", "default", "rain", "cloudy", "night", "cloudy", "night", "default", "rain",
)  # fmt: skip
"""Of every ten scenarios 3 cloudy, 3 night, 2 default, 2 rain (paper, "Scenario Description")."""
Proposer = Callable[[Category, str], Proposal]
"""Maps category and seed to a proposal; raises ProposalRejected if it has none."""


@dataclass(frozen=True, slots=True)
class GenerationRequest:
    """What is to be generated."""

    category: Category
    count: int
    seed: int = 0
    split: Literal["public", "hidden"] = "public"
    secret: str = ""
    """Known to the organiser of a hidden split only; part of every seed."""

    def attempt_seed(self, number: int) -> str:
        """Return the seed of the attempt with that number; the secret cannot be derived from it."""
        text = "/".join((str(GENERATOR), self.split, self.secret, self.category, str(self.seed), str(number)))
        return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()

    def scenario_id(self, number: int) -> str:
        """Return the id of the attempt's scenario; ids of hidden and public scenarios differ."""
        return f"{self.category}_{'h' if self.split == 'hidden' else ''}{self.attempt_seed(number)[:8]}"


@dataclass(frozen=True, slots=True)
class GenerationAttempt:
    """Result of one proposal: a scenario, or the stage that rejected it and why."""

    number: int
    recipe: Recipe | None
    scenario: Scenario | None
    screening: ScreeningResult | None
    rejection: tuple[str, str] | None = None
    """Stage and reason."""


def propose_from_template(category: Category, seed: str) -> Proposal:
    """Propose from a template, without any service."""
    return template_proposer.propose(category, random.Random(f"{seed}/proposal"))


def search_scenarios(
    order: GenerationRequest,
    proposer: Proposer = propose_from_template,
    known: Sequence[Scenario] = (),
    name: str = "template",
) -> Iterator[GenerationAttempt]:
    """Return attempts until `count` scenarios are found, none a duplicate of `known`; gives up after `MAX_TRIES` per
    scenario."""
    accepted: list[Scenario] = []
    for number in range(order.count * MAX_TRIES):
        if len(accepted) == order.count:
            return
        attempt = _make_attempt(order, number, (proposer, name), accepted, known)
        if attempt.scenario is not None:
            accepted.append(attempt.scenario)
        yield attempt


def _make_attempt(
    order: GenerationRequest,
    number: int,
    by: tuple[Proposer, str],
    accepted: Sequence[Scenario],
    known: Sequence[Scenario],
) -> GenerationAttempt:
    recipe: Recipe | None = None
    try:
        recipe = _draw_recipe(order, number, by, WEATHER[len(accepted) % len(WEATHER)])
        scenario = build_scenario(recipe)
        return GenerationAttempt(number, recipe, scenario, screen_candidate(scenario, [*known, *accepted]))
    except ProposalRejected as refused:
        return GenerationAttempt(number, recipe, None, None, (refused.stage, refused.reason))


def _draw_recipe(
    order: GenerationRequest, number: int, by: tuple[Proposer, str], weather: WeatherName = "default"
) -> Recipe:
    seed = order.attempt_seed(number)
    proposal = by[0](order.category, seed)
    return Recipe(id=order.scenario_id(number), seed=seed, proposer=by[1], weather=weather, proposal=proposal)


def build_public_counterparts(order: GenerationRequest) -> Iterator[Scenario]:
    """Return all candidates for the public split with the same seed that templates make; none is driven."""
    public = replace(order, split="public", secret="")
    for number in range(order.count * MAX_TRIES):
        try:
            yield build_scenario(_draw_recipe(public, number, (propose_from_template, "template")))
        except ProposalRejected:
            continue
