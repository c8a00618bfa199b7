"""Generation pipeline: from a proposal to a scenario that is valid, feasible, difficult and new; every stage gives the
reason of a rejection.

proposal -> rules -> crop -> ways -> spawns -> actors -> soundness -> duplicates -> difficulty -> feasibility
"""

import random
from collections.abc import Mapping, Sequence

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.generate.category_requirements import INTERDRIVE_ROUTE_M, Category, find_requirements
from mdrive_sumo.generate.drawn_places import open_place
from mdrive_sumo.generate.duplicates import find_duplicate
from mdrive_sumo.generate.network_choice import find_networks
from mdrive_sumo.generate.pre_crash_typologies import find_typology_networks
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected, reject_at
from mdrive_sumo.generate.route_assignment import assign_routes
from mdrive_sumo.generate.rules import find_rule_violations
from mdrive_sumo.generate.screening import ScreeningResult, screen_scenario
from mdrive_sumo.generate.start_shift import find_start_shift
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.categories import InterDriveCategory
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.worlds.encounters.pre_crash_actors import place_pre_crash_actors
from mdrive_sumo.worlds.encounters.pre_crash_spawn_points import choose_pre_crash_spawn_points as pre_crash_spawns
from mdrive_sumo.worlds.encounters.route_actors import place_actors
from mdrive_sumo.worlds.placement.cavs import SpawnPoint, build_spawned_cav
from mdrive_sumo.worlds.placement.lane_chains import build_way_line
from mdrive_sumo.worlds.placement.spawn_points import LaneRoutes, choose_spawn_points

BUCKET, INTERDRIVE_BUCKET = "Interaction", "InterDrive"
INTERDRIVE_RUN_UP_M = (14.0, 28.0)
"""[m] Distance from start to conflict of the first CAV: routes of 52 m leave room for a turn and a queue."""
INTERDRIVE_ROUTE_SHARE = 0.93
"""Share of the mean route length: conflicts and lane changes lengthen many routes. Chosen on season 4: with 1.0 routes
of seasons 1 to 3 were 4 to 6 % above the paper's, with 0.93 those of season 4 are 0.1 % above."""
DEFAULT_ROUTE_M = 100.0
"""[m] Length of routes where the paper lists none."""


def build_scenario(recipe: Recipe, networks: Sequence[str] = (), roads: RoadMap | None = None) -> Scenario:
    """Run the stages up to soundness; raises ProposalRejected.

    networks: names of those to choose from instead of the category's. roads: the network of a recipe with a place.
    """
    if roads is None and recipe.place is not None:
        with open_place(recipe.place) as drawn:
            return build_scenario(recipe, roads=drawn)
    proposal, rng = recipe.proposal, random.Random(recipe.seed)
    if wrong := find_rule_violations(proposal):
        raise ProposalRejected(PipelineStage.RULES, "; ".join(wrong))
    roads = roads or _choose_network(proposal, networks, rng)
    ways = assign_routes(proposal, roads, rng)
    if ways is None:
        raise ProposalRejected(
            PipelineStage.WAYS, f"network {roads.name}: expected ways that keep all relations, found none"
        )
    egos = _build_egos(proposal, ways, roads, rng)
    actors = _place_actors(proposal, egos, roads, rng)
    is_interdrive = isinstance(proposal.category, InterDriveCategory)
    scenario = Scenario(
        id=recipe.id,
        bucket=INTERDRIVE_BUCKET if is_interdrive else BUCKET,
        category=proposal.category,
        network=roads.name,
        description=proposal.description,
        egos=tuple(egos.values()),
        actors=actors,
        signals=recipe.signals,
        weather=recipe.weather,
        # Not at lights that run: 15 m are 2 s, and `omniscient` would meet other phases than those of its screening.
        start_shift=find_start_shift(tuple(egos.values()), actors, roads)
        if recipe.place and recipe.signals == "frozen-green"
        else None,
    )
    with reject_at(PipelineStage.SOUNDNESS):
        check_scenario(scenario, roads)
    return scenario


def _choose_network(proposal: Proposal, networks: Sequence[str], rng: random.Random) -> RoadMap:
    names = networks or find_typology_networks(proposal) or find_requirements(proposal.category).networks
    with reject_at(PipelineStage.CROP):
        return rng.choice(find_networks(proposal, names))


def _build_egos(proposal: Proposal, ways: LaneRoutes, roads: RoadMap, rng: random.Random) -> dict[str, Ego]:
    """Return the CAVs by the proposal's vehicle ids."""
    share = rng.uniform(0.25, 0.6)
    with reject_at(PipelineStage.SPAWNS, f"network {roads.name}: "):
        spawns = _choose_spawns(proposal, ways, share, roads, rng)
        return {
            name: build_spawned_cav(roads, str(i), way, spawns[name], share)
            for i, (name, way) in enumerate(ways.items())
        }


def _choose_spawns(
    proposal: Proposal, ways: LaneRoutes, share: float, roads: RoadMap, rng: random.Random
) -> dict[str, SpawnPoint]:
    """Return starts and goals. Raises NoRoomError."""
    lines = {name: build_way_line(roads, way, share) for name, way in ways.items()}
    figures = find_requirements(proposal.category).paper
    route_m = figures.route_m if figures else DEFAULT_ROUTE_M
    if isinstance(proposal.category, InterDriveCategory):
        route_m = INTERDRIVE_ROUTE_SHARE * INTERDRIVE_ROUTE_M[proposal.category]
        return choose_spawn_points(lines, ways, route_m, rng, INTERDRIVE_RUN_UP_M)
    if proposal.category is Category.PRE_CRASH:  # they begin close to the junction
        return pre_crash_spawns(proposal.actors, lines, ways, roads, route_m, rng)
    return choose_spawn_points(lines, ways, route_m, rng)


def _place_actors(proposal: Proposal, egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random) -> tuple[Actor, ...]:
    place = place_pre_crash_actors if proposal.category is Category.PRE_CRASH else place_actors
    with reject_at(PipelineStage.ACTORS):
        return place(proposal.actors, egos, roads, rng)


def screen_candidate(scenario: Scenario, accepted: Sequence[Scenario], roads: RoadMap | None = None) -> ScreeningResult:
    """Run the stages after soundness; raises ProposalRejected. roads: the network, unless it is a packaged one."""
    if (twin := find_duplicate(scenario, accepted)) is not None:
        raise ProposalRejected(PipelineStage.DUPLICATES, f"expected something new, found a duplicate of {twin.id}")
    roads = roads or load_road_map(find_network_folder(scenario.network))
    if inside := list(find_spawn_overlaps(scenario, roads)):
        raise ProposalRejected(
            PipelineStage.SOUNDNESS, f"expected no overlapping boxes at the start, found that {inside[0]}"
        )
    try:
        found = screen_scenario(scenario, roads)
    except WorldError as error:
        raise ProposalRejected(PipelineStage.FEASIBILITY, f"expected an episode, found none: {error}") from None
    if not found.is_difficult:
        ttc = "none" if found.blind_ttc_s is None else f"{found.blind_ttc_s:.2f} s"
        raise ProposalRejected(PipelineStage.DIFFICULTY, f"expected a blind TTC below 0.9 s, found {ttc}")
    if not found.is_feasible:
        raise ProposalRejected(
            PipelineStage.FEASIBILITY, f"expected omniscient to reach DS 100, found {found.omniscient_ds:.2f}"
        )
    return found
