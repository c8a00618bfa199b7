"""The pipeline: from a proposal to a scenario that is legal, feasible, difficult and new; every stage says why not.

proposal -> rules -> crop -> ways -> spawns -> actors -> soundness -> duplicates -> difficulty -> feasibility
"""

import random
from collections.abc import Mapping, Sequence
from enum import StrEnum

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.generate.actor_placement import actors_of
from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.duplicates import duplicate_of
from mdrive_sumo.generate.network_features import crops_for
from mdrive_sumo.generate.pre_crash_placement import pre_crash_actors
from mdrive_sumo.generate.pre_crash_spawn_points import spawns as pre_crash_spawns
from mdrive_sumo.generate.pre_crash_typologies import crops_of
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.route_assignment import assign
from mdrive_sumo.generate.rules import problems
from mdrive_sumo.generate.screening import Screened, screen
from mdrive_sumo.generate.spawn_points import Spawn, Ways, ego_of, line_of, spawns
from mdrive_sumo.generate.validation.spawn_overlaps import crowded
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor

BUCKET = "Interaction"
ROUTE_M = 100.0
"""Length of routes where the paper lists none."""


class Stage(StrEnum):
    """Stages in their order."""

    RULES = "rules"
    CROP = "crop"
    WAYS = "ways"
    SPAWNS = "spawns"
    ACTORS = "actors"
    SOUNDNESS = "soundness"
    DUPLICATES = "duplicates"
    DIFFICULTY = "difficulty"
    FEASIBILITY = "feasibility"


class Rejected(Exception):
    """A stage refused; `args` are its name and the reason."""

    def __init__(self, stage: Stage, reason: str) -> None:
        super().__init__(stage, reason)
        self.stage, self.reason = stage, reason


def built(recipe: Recipe) -> Scenario:
    """Stages up to soundness; raises Rejected."""
    proposal, rng = recipe.proposal, random.Random(recipe.seed)
    if wrong := problems(proposal):
        raise Rejected(Stage.RULES, "; ".join(wrong))
    roads = _crop(proposal, rng)
    ways = assign(proposal, roads, rng)
    if ways is None:
        raise Rejected(Stage.WAYS, f"network {roads.name}: expected ways that keep all relations, found none")
    egos = _egos(proposal, ways, roads, rng)
    actors = _actors(proposal, egos, roads, rng)
    scenario = Scenario(
        id=recipe.id,
        bucket=BUCKET,
        category=proposal.category,
        network=roads.name,
        description=proposal.description,
        egos=tuple(egos.values()),
        actors=actors,
        weather=recipe.weather,
    )
    try:
        check_scenario(scenario, roads)
    except InputError as error:
        raise Rejected(Stage.SOUNDNESS, str(error)) from None
    return scenario


def _crop(proposal: Proposal, rng: random.Random) -> RoadMap:
    try:
        return rng.choice(crops_for(proposal, crops_of(proposal) or CATEGORIES[proposal.category].crops))
    except InputError as error:
        raise Rejected(Stage.CROP, str(error)) from None


def _egos(proposal: Proposal, ways: Ways, roads: RoadMap, rng: random.Random) -> dict[str, Ego]:
    """CAVs by the proposal's vehicle ids."""
    share = rng.uniform(0.25, 0.6)
    try:
        placed = _placed(proposal, ways, share, roads, rng)
        if isinstance(placed, str):
            raise InputError(placed)
        return {name: ego_of(roads, str(i), way, placed[name], share) for i, (name, way) in enumerate(ways.items())}
    except InputError as error:
        raise Rejected(Stage.SPAWNS, f"network {roads.name}: {error}") from None


def _placed(proposal: Proposal, ways: Ways, share: float, roads: RoadMap, rng: random.Random) -> dict[str, Spawn] | str:
    """Starts and goals, or why there are none."""
    lines = {name: line_of(roads, way, share) for name, way in ways.items()}
    figures = CATEGORIES[proposal.category].paper
    route_m = figures.route_m if figures else ROUTE_M
    if proposal.category is Category.PRE_CRASH:  # they begin close to the junction
        return pre_crash_spawns(proposal, lines, ways, roads, route_m, rng)
    return spawns(lines, ways, route_m, rng)


def _actors(proposal: Proposal, egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random) -> tuple[Actor, ...]:
    place = pre_crash_actors if proposal.category is Category.PRE_CRASH else actors_of
    try:
        return place(proposal.actors, egos, roads, rng)
    except InputError as error:
        raise Rejected(Stage.ACTORS, str(error)) from None


def screened(scenario: Scenario, accepted: Sequence[Scenario]) -> Screened:
    """Stages after soundness; raises Rejected."""
    if (twin := duplicate_of(scenario, accepted)) is not None:
        raise Rejected(Stage.DUPLICATES, f"expected something new, found a duplicate of {twin.id}")
    roads = load_road_map(find_network_folder(scenario.network))
    if inside := list(crowded(scenario, roads)):
        raise Rejected(Stage.SOUNDNESS, f"expected room for everybody at the start, found that {inside[0]}")
    try:
        found = screen(scenario, roads)
    except WorldError as error:
        raise Rejected(Stage.FEASIBILITY, f"expected an episode, found none: {error}") from None
    if not found.difficult:
        ttc = "none" if found.blind_ttc_s is None else f"{found.blind_ttc_s:.2f} s"
        raise Rejected(Stage.DIFFICULTY, f"expected a blind TTC below 0.9 s, found {ttc}")
    if not found.feasible:
        raise Rejected(Stage.FEASIBILITY, f"expected omniscient to reach DS 100, found {found.omniscient_ds:.2f}")
    return found
