"""Training scenarios: drawn by a private seed on the networks `train_*`, which no suite uses.

The same split, seed and index make the same scenario with the same version of the generator. `train` and `val` share
neither networks nor seeds.
"""

import hashlib
import random
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.network_choice import is_for_training
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.learning.sample_format import SPLITS
from mdrive_sumo.learning.training_situations import SITUATIONS, SituationPlan
from mdrive_sumo.roads import RoadMap, find_network_folder, list_packaged_networks, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.worlds.encounters.crossing_users import CrossingRequest, build_crossing_users, build_leading_cyclist
from mdrive_sumo.worlds.encounters.route_actors import fit_to_lane_width, is_behind_bend, place_actors
from mdrive_sumo.worlds.placement.occupancy import build_occupancy, select_free_actors
from mdrive_sumo.worlds.placement.parked_vehicles import build_parked_vehicles
from mdrive_sumo.worlds.placement.route_cavs import build_route_cavs, draw_start_speeds
from mdrive_sumo.worlds.streams.near_traffic import TrafficRequest, build_near_traffic

VERSION = 1
"""Version of this generator, part of every seed; incremented whenever the same arguments would make another
scenario."""
BUCKET = "Training"
VALIDATION_PREFIX = "train_val_"
TEMPLATE, TEMPLATE_SHARE = "template", 0.15
"""Kind and share of scenarios that the templates of the Interaction categories propose, on training networks."""
WEATHERS: Mapping[WeatherName, float] = MappingProxyType({"default": 0.3, "cloudy": 0.25, "night": 0.25, "rain": 0.2})
MAX_TRIES, SAME_KIND_TRIES = 60, 20
"""Draws of one scenario, and those before its kind is drawn again."""


def build_training_scenario(split: str, seed: int, index: int) -> Scenario | None:
    """Return the training scenario with that index; None if no draw was sound, which 60 draws make very unlikely.

    split: `train` or `val`. Raises InputError for another one.
    """
    names = list_training_networks(split)
    kind = _draw_kind(random.Random(_derive_seed(split, seed, index, "kind")))
    for attempt in range(MAX_TRIES):
        key = _derive_seed(split, seed, index, str(attempt))
        rng = random.Random(key)
        kind = kind if attempt < SAME_KIND_TRIES else _draw_kind(rng)
        try:
            return _build_sound(f"{split}-{kind}-{key[:10]}", kind, names, rng)
        except (ProposalRejected, InputError):
            continue
    return None


def list_training_networks(split: str) -> tuple[str, ...]:
    """Return the names of the networks of a split. Raises InputError for a split that there is not."""
    if split not in SPLITS:
        raise InputError(f"split: expected {' or '.join(SPLITS)}, found {split!r}")
    names = (name for name in list_packaged_networks() if is_for_training(name))
    return tuple(name for name in names if name.startswith(VALIDATION_PREFIX) == (split == "val"))


def _derive_seed(split: str, seed: int, index: int, purpose: str) -> str:
    text = "/".join(("training", str(VERSION), split, str(seed), str(index), purpose))
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


def _draw_kind(rng: random.Random) -> str:
    if rng.random() < TEMPLATE_SHARE:
        return TEMPLATE
    return rng.choices(list(SITUATIONS), [one.share for one in SITUATIONS.values()])[0]


def _draw_weather(rng: random.Random) -> WeatherName:
    return rng.choices(list(WEATHERS), list(WEATHERS.values()))[0]


def _build_sound(name: str, kind: str, networks: Sequence[str], rng: random.Random) -> Scenario:
    """Return a scenario of that kind. Raises InputError or ProposalRejected if it is not sound."""
    build = _build_from_template if kind == TEMPLATE else _build_situation
    scenario = build(name, kind, networks, rng)
    roads = load_road_map(find_network_folder(scenario.network))
    check_scenario(scenario, roads)
    if overlap := next(find_spawn_overlaps(scenario, roads), None):
        raise InputError(f"scenario {scenario.id}: {overlap}")
    return scenario


def _build_from_template(name: str, _kind: str, networks: Sequence[str], rng: random.Random) -> Scenario:
    proposal = propose(rng.choice(tuple(Category)), rng)
    recipe = Recipe(id=name, seed=name, weather=_draw_weather(rng), proposal=proposal)
    return build_scenario(recipe, networks).model_copy(update={"bucket": BUCKET})


def _build_situation(name: str, kind: str, networks: Sequence[str], rng: random.Random) -> Scenario:
    roads, plan = _draw_plan(kind, networks, rng)
    egos = build_route_cavs(plan.ways, plan.route_m, roads, rng)
    actors = _build_actors(plan, egos, roads, rng)
    request = TrafficRequest(plan.queue, plan.traffic, plan.is_jammed)
    vehicles = build_near_traffic(roads, tuple(egos.values()), actors, request, rng)
    others = build_occupancy(actors, vehicles, roads).boxes
    return Scenario(
        id=name,
        bucket=BUCKET,
        category=kind,
        network=roads.name,
        description=(SITUATIONS[kind].draw.__doc__ or "").strip(),
        egos=draw_start_speeds(tuple(egos.values()), others, rng),
        background=Background(vehicles=vehicles),
        actors=actors,
        weather=_draw_weather(rng),
    )


def _draw_plan(kind: str, networks: Sequence[str], rng: random.Random) -> tuple[RoadMap, SituationPlan]:
    """Return a network and what it shall stage. Raises InputError where it cannot."""
    situation = SITUATIONS[kind]
    fitting = [network for network in networks if situation.fits(network)]
    if not fitting:
        raise InputError(f"situation {kind}: expected a network of the split that can stage it, found none")
    roads = load_road_map(find_network_folder(rng.choice(fitting)))
    plan = situation.draw(roads, rng)
    if plan is None:
        raise InputError(f"network {roads.name}: expected lane routes for situation {kind}, found none")
    return roads, plan


def _build_actors(
    plan: SituationPlan, egos: Mapping[str, Ego], roads: RoadMap, rng: random.Random
) -> tuple[Actor, ...]:
    """Return the scripted actors that have room. Raises InputError if none of those that the plan is about has."""
    cavs = tuple(egos.values())
    made = [fit_to_lane_width(actor, roads) for actor in place_actors(plan.obstacles, egos, roads, rng)]
    if any(is_behind_bend(actor, next(iter(egos.values()))) for actor in made):
        raise InputError(f"network {roads.name}: expected obstacles on a straight, found one behind a bend")
    crossing = [CrossingRequest("adult", k < plan.hidden_walkers) for k in range(plan.walkers)]
    crossing += [CrossingRequest("bicycle", False)] * plan.crossing_cyclists
    made += build_crossing_users(roads, cavs, crossing, rng)
    if plan.leading_cyclists and (cyclist := build_leading_cyclist(roads, cavs[0], rng)):
        made.append(cyclist)
    essential = {actor.id for actor in made if not actor.id.startswith("screen")}
    made += build_parked_vehicles(roads, cavs, plan.parked, rng)
    chosen = select_free_actors(roads, cavs, made)
    wanted = len(plan.obstacles) + len(crossing) + plan.leading_cyclists
    if wanted and not essential.intersection(actor.id for actor in chosen):
        raise InputError(f"network {roads.name}: expected room for what the situation is about, found none")
    return chosen
