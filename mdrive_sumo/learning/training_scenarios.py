"""Training scenarios: drawn by a split, a seed and an index on places of the factory that no suite uses.

The same split, seed and index make the same scenario with the same version of the generator. Splits share neither
places nor seeds.
"""

import hashlib
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.network_choice import is_suitable
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.learning.training_places import KIND_SHARES, find_place, open_training_place
from mdrive_sumo.learning.training_situations import CROWD, SITUATIONS, SituationPlan
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.start_boxes import build_box, build_user_box, find_departure_pose
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.worlds.encounters.crossing_users import CrossingRequest, build_crossing_users, build_leading_cyclist
from mdrive_sumo.worlds.encounters.route_actors import fit_to_lane_width, is_behind_bend, place_actors
from mdrive_sumo.worlds.network_features import HIGHWAY_MPS, extract_features
from mdrive_sumo.worlds.placement.blind_driving import BLIND_SPEED
from mdrive_sumo.worlds.placement.bodies import build_parked_vehicle
from mdrive_sumo.worlds.placement.occupancy import select_free_actors
from mdrive_sumo.worlds.placement.parked_vehicles import build_parked_vehicles
from mdrive_sumo.worlds.placement.route_cavs import build_route_cavs
from mdrive_sumo.worlds.placement.start_speeds import draw_road_speeds, draw_start_speeds
from mdrive_sumo.worlds.streams.near_traffic import TrafficRequest, build_near_traffic
from mdrive_sumo.worlds.traffic import Traffic, draw_traffic, find_demand
from mdrive_sumo.worlds.traffic.driving_vehicles import is_street
from mdrive_sumo.worlds.traffic.occupancy import TakenGround
from mdrive_sumo.worlds.traffic.parked_streets import draw_parked

VERSION = 2
"""Version of this generator, part of every seed; incremented whenever the same arguments would make another scenario.
2: drawn places instead of 16 packaged networks."""
BUCKET = "Training"
TEMPLATE, TEMPLATE_SHARE = "template", 0.09
"""Kind and share of scenarios that the templates of the Interaction categories propose."""
PROPOSALS = 40
"""Proposals that are drawn until one suits the place: of eleven categories most places suit two or more."""
WEATHERS: Mapping[WeatherName, float] = MappingProxyType({"default": 0.3, "cloudy": 0.25, "night": 0.25, "rain": 0.2})
MAX_TRIES, SAME_KIND_TRIES = 60, 12
"""Draws of one scenario, and those before its kind is drawn again."""
ROAD_SPEED_SHARE, FAST_ROAD_SPEED_SHARE = 0.4, 0.85
"""Share of scenarios whose CAVs drive as fast as the road allows, and where it allows 60 km/h or more: at 8 m/s, as in
the protocol, only few drive there. Templates and crowded places have the speed of the protocol. Chosen."""
LONGEST_STRETCH = 4.0
"""Factor on lengths for CAVs at 32 m/s: the ways of motorways have half a kilometre or more."""
LEAST_RADIUS_M, BEND_M = 4.5, 3
"""[m] Least radius of a route, and the length over which it is measured; lane changes on short lanes are sharpest."""
SIGNALS_SHARE = 0.6
"""Share of scenarios at places with lights in which these run; at rest they are green, as in the paper's suites."""
CROWD_PEOPLE = (0.25, 0.75)
"""Bounds of the share of people on foot among those of a crowded place; the others are parked vehicles. Chosen."""
ROW_DEMAND = "town-quiet"
"""Demand of which the share of taken parking places is used where a scenario is not crowded."""
CROWD_DEMANDS = ("town-quiet", "town-busy", "old-town")
CROWD_VEHICLES = 16
"""Vehicles that SUMO drives in a crowded place at most: those nearest to the CAVs."""


@dataclass(frozen=True, slots=True)
class _Stage:
    """Where a scenario is staged, and how fast."""

    name: str
    kind: str
    roads: RoadMap
    at_road_speed: bool


def build_training_scenario(split: str, seed: int, index: int, places: Path) -> tuple[Scenario, RoadMap] | None:
    """Return the training scenario with that index and its network; None if no draw was sound, which 60 draws make
    very unlikely.

    split: `train`, `val` or `test`. places: folder in which its place lies, or is drawn. Raises InputError for another
    split, and without netconvert for a place that does not lie there.
    """
    try:
        place_kind, roads = open_training_place(find_place(split, seed, index, places))
    except ProposalRejected:
        return None
    kind = _draw_kind(place_kind, random.Random(_derive_seed(split, seed, index, "kind")))
    for attempt in range(MAX_TRIES):
        key = _derive_seed(split, seed, index, str(attempt))
        rng = random.Random(key)
        kind = kind if attempt < SAME_KIND_TRIES else _draw_kind(place_kind, rng)
        stage = _Stage(f"{split}-{kind}-{key[:10]}", kind, roads, _draw_speed_rule(kind, roads, rng))
        try:
            return _build_sound(stage, rng), roads
        except (ProposalRejected, InputError):
            continue
    return None


def _derive_seed(split: str, seed: int, index: int, purpose: str) -> str:
    text = "/".join(("training", str(VERSION), split, str(seed), str(index), purpose))
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


def _draw_kind(place_kind: str, rng: random.Random) -> str:
    """Return a kind of scenario for a kind of place. The fewer places can stage it, the more often it is drawn there,
    so that its share of all scenarios comes near the one that is aimed at."""
    weights = {TEMPLATE: TEMPLATE_SHARE}
    for name, situation in SITUATIONS.items():
        if situation.fits(place_kind):
            weights[name] = situation.share / sum(share for kind, share in KIND_SHARES.items() if situation.fits(kind))
    return rng.choices(list(weights), list(weights.values()))[0]


def _draw_speed_rule(kind: str, roads: RoadMap, rng: random.Random) -> bool:
    """Return whether CAVs drive as fast as the road allows."""
    fastest = max(lane.speed_limit for lane in roads.driving)
    share = FAST_ROAD_SPEED_SHARE if fastest > HIGHWAY_MPS else ROAD_SPEED_SHARE
    return rng.random() < share and kind not in (TEMPLATE, "crowded")


def _draw_weather(rng: random.Random) -> WeatherName:
    return rng.choices(list(WEATHERS), list(WEATHERS.values()))[0]


def _build_sound(stage: _Stage, rng: random.Random) -> Scenario:
    """Return a scenario of that kind. Raises InputError or ProposalRejected if it is not sound."""
    scenario = _build_from_template(stage, rng) if stage.kind == TEMPLATE else _build_situation(stage, rng)
    if any(lane.lights for lane in stage.roads.driving) and rng.random() < SIGNALS_SHARE:
        scenario = scenario.model_copy(update={"signals": "program"})
    check_scenario(scenario, stage.roads)
    for ego in scenario.egos:
        _check_bends(ego)
    if overlap := next(find_spawn_overlaps(scenario, stage.roads), None):
        raise InputError(f"scenario {scenario.id}: {overlap}")
    return scenario


def _check_bends(ego: Ego) -> None:
    """Check that a car can follow a route. Raises InputError for one that jumps aside, as where netconvert leads the
    right lane of a motorway onto the deceleration lane within a few metres."""
    hops = np.diff(ego.xy, axis=0)
    yaws = portable.atan2(hops[:, 1], hops[:, 0])
    turned = [abs(wrap_angle(angle)) for angle in (yaws[BEND_M:] - yaws[:-BEND_M]).tolist()]
    if max(turned, default=0.0) > BEND_M / LEAST_RADIUS_M:
        raise InputError(
            f"CAV {ego.id}: expected a route of bends of {LEAST_RADIUS_M:g} m or more, found a sharper one"
        )


def _build_from_template(stage: _Stage, rng: random.Random) -> Scenario:
    features = extract_features(stage.roads)
    drawn = (propose(rng.choice(tuple(Category)), rng) for _ in range(PROPOSALS))
    proposal = next((one for one in drawn if is_suitable(features, one)), None)
    if proposal is None:
        raise InputError(f"network {stage.roads.name}: expected a proposal that suits it, found none")
    recipe = Recipe(id=stage.name, seed=stage.name, weather=_draw_weather(rng), proposal=proposal)
    return build_scenario(recipe, roads=stage.roads).model_copy(update={"bucket": BUCKET})


def _build_situation(stage: _Stage, rng: random.Random) -> Scenario:
    roads, situation = stage.roads, SITUATIONS[stage.kind]
    plan = situation.draw(roads, rng)
    if plan is None:
        raise InputError(f"network {roads.name}: expected lane routes for situation {stage.kind}, found none")
    pace = _find_pace(plan, roads) if stage.at_road_speed else BLIND_SPEED
    stretch = min(max(pace / BLIND_SPEED, 1.0), LONGEST_STRETCH)
    egos = build_route_cavs(plan.ways, plan.route_m, roads, rng, stretch)
    cavs = tuple(egos.values())
    actors = _build_actors(plan, egos, roads, pace, rng)
    traffic = _draw_crowd(plan, cavs, actors, roads, rng) if plan.crowd else None
    if traffic is None:
        request = TrafficRequest(plan.queue, plan.traffic, plan.is_jammed, stage.at_road_speed)
        traffic = Traffic(build_near_traffic(roads, cavs, actors, request, rng), actors)
    others = _list_boxes(traffic, roads)
    moving = draw_road_speeds(roads, cavs, others, rng) if stage.at_road_speed else draw_start_speeds(cavs, others, rng)
    return Scenario(
        id=stage.name,
        bucket=BUCKET,
        category=stage.kind,
        network=roads.name,
        description=(situation.draw.__doc__ or "").strip(),
        speeds="road" if stage.at_road_speed else "protocol",
        egos=moving,
        background=Background(vehicles=traffic.vehicles),
        actors=traffic.actors,
        weather=_draw_weather(rng),
    )


def _find_pace(plan: SituationPlan, roads: RoadMap) -> float:
    """Return the greatest speed limit [m/s] on the way of the first CAV."""
    first = next(iter(plan.ways.values()))
    return max(roads.lanes[lane].speed_limit for lane in first.lanes)


def _list_boxes(traffic: Traffic, roads: RoadMap) -> list[shapely.Polygon]:
    """Return the boxes of all road users beside the CAVs that are there at the start, except on cycle lanes."""
    boxes = [build_user_box(actor) for actor in traffic.actors]
    present = ((one, find_departure_pose(one, roads)) for one in traffic.vehicles if one.depart_s == 0.0)
    return boxes + [build_box(pose, one.length, one.width) for one, pose in present if pose is not None]


def _draw_crowd(
    plan: SituationPlan, cavs: Sequence[Ego], actors: tuple[Actor, ...], roads: RoadMap, rng: random.Random
) -> Traffic:
    """Return the road users of a crowded place. Raises InputError if it has room for fewer than `CROWD`."""
    people = round(rng.uniform(*CROWD_PEOPLE) * plan.crowd)
    demand = replace(
        find_demand(rng.choice(CROWD_DEMANDS)),
        kerb_share=1.0,
        most_people=people,
        most_parked=plan.crowd - people - len(actors),
        most_vehicles=CROWD_VEHICLES,
        walkers_per_km=80.0,  # more than there shall be: those nearest to the CAVs stay
    )
    traffic = draw_traffic(roads, cavs, actors, demand, rng)
    if not CROWD[0] <= len(traffic.actors) <= CROWD[1]:
        raise InputError(f"network {roads.name}: expected room for {CROWD[0]} road users, found {len(traffic.actors)}")
    return traffic


def _build_actors(
    plan: SituationPlan, egos: Mapping[str, Ego], roads: RoadMap, pace: float, rng: random.Random
) -> tuple[Actor, ...]:
    """Return the scripted actors that have room. Raises InputError if none of those that the plan is about has."""
    cavs = tuple(egos.values())
    made = [fit_to_lane_width(actor, roads) for actor in place_actors(plan.obstacles, egos, roads, rng)]
    if any(is_behind_bend(actor, next(iter(egos.values()))) for actor in made):
        raise InputError(f"network {roads.name}: expected obstacles on a straight, found one behind a bend")
    crossing = [CrossingRequest("adult", k < plan.hidden_walkers) for k in range(plan.walkers)]
    crossing += [CrossingRequest("bicycle", False)] * plan.crossing_cyclists
    made += build_crossing_users(roads, cavs, crossing, rng, pace)
    if plan.leading_cyclists and (cyclist := build_leading_cyclist(roads, cavs[0], rng)):
        made.append(cyclist)
    essential = {actor.id for actor in made if not actor.id.startswith("screen")}
    made += _park(plan, cavs, made, roads, rng)
    chosen = select_free_actors(roads, cavs, made)
    wanted = len(plan.obstacles) + len(crossing) + plan.leading_cyclists
    if wanted and not plan.crowd and not essential.intersection(actor.id for actor in chosen):
        raise InputError(f"network {roads.name}: expected room for what the situation is about, found none")
    return chosen


def _park(
    plan: SituationPlan, cavs: Sequence[Ego], actors: Sequence[Actor], roads: RoadMap, rng: random.Random
) -> list[Actor]:
    """Return parked vehicles near the CAVs: in the rows of the place if it has some, else at the kerbs of streets."""
    if not roads.parking:
        has_streets = any(is_street(lane) for lane in roads.driving)
        return list(build_parked_vehicles(roads, cavs, plan.parked, rng)) if has_streets else []
    parked = draw_parked(roads, find_demand(ROW_DEMAND), TakenGround(cavs, actors), rng) if plan.parked else []
    starts = [(ego.start.x, ego.start.y) for ego in cavs]
    near = sorted(parked, key=lambda one: min(portable.distance((one.pose.x, one.pose.y), start) for start in starts))
    return [
        build_parked_vehicle(f"parked_{k}", place.model, place.pose, mirrored=False)
        for k, place in enumerate(near[: plan.parked])
    ]
