"""Pre-crash scenarios: every typology's proposals keep the rules, and what they say is built, hidden and dangerous."""

import math
import random

import pytest
import shapely
from testing.sampling import sampled

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.generate import pre_crash_typologies
from mdrive_sumo.generate.built_in_drive import drive_episode
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.generate.rules import find_rule_violations
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.roads import Lane, RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, DistanceTrigger, HardBrake, PathMotion
from mdrive_sumo.scoring import ScoreMode, score_episode
from mdrive_sumo.study.occlusion_certificate import (
    DRIVES,
    OcclusionCertificate,
    ReferenceDrive,
    find_occluded_intervals,
)
from mdrive_sumo.worlds.placement.blind_driving import (
    BLIND_ACCELERATION,
    BLIND_SPEED,
    blind_travel_time,
    compute_arrival_s,
)
from mdrive_sumo.worlds.placement.lane_chains import RouteLine

pytestmark = pytest.mark.slow

NUMBERS = sorted(pre_crash_typologies.TYPOLOGIES)
SEEDS = 8


def proposal_of(number: int, seed: int) -> Proposal:
    fields = pre_crash_typologies.draft_typology(number, random.Random(f"{number}/{seed}"))
    return Proposal.model_validate({"category": Category.PRE_CRASH, **fields})


def made(number: int, seed: int) -> Scenario:
    return build_scenario(Recipe(id=f"pre_crash_{number}", seed=f"{number}/{seed}", proposal=proposal_of(number, seed)))


def first_made(number: int, network: str = "") -> Scenario:
    """The first scenario that can be built of a typology (on a network)."""
    for seed in range(40):
        try:
            scenario = made(number, seed)
        except ProposalRejected:
            continue
        if network in ("", scenario.network):
            return scenario
    raise AssertionError(f"typology {number}: nothing could be built")


def actor(scenario: Scenario, start: str) -> Actor:
    return next(actor for actor in scenario.actors if actor.id.startswith(start))


@pytest.mark.parametrize("number", NUMBERS)
def test_proposals_of_a_typology_keep_the_rules(number: int) -> None:
    for seed in range(SEEDS):
        proposal = proposal_of(number, seed)
        assert find_rule_violations(proposal) == ()
        assert proposal.pre_crash == number
        assert f"typology {number}," in proposal.description


def test_template_proposes_all_typologies() -> None:
    found = {propose(Category.PRE_CRASH, random.Random(seed)).pre_crash for seed in range(150)}
    assert found == set(NUMBERS)


@pytest.mark.parametrize("number", NUMBERS)
def test_a_typology_is_staged_on_its_networks(number: int) -> None:
    scenario = first_made(number)
    assert scenario.category == "pre-crash"
    assert scenario.network in pre_crash_typologies.TYPOLOGIES[number].networks


def test_other_typologies_take_any_network() -> None:
    fields = proposal_of(30, 0).model_dump() | {"pre_crash": 37}
    assert pre_crash_typologies.find_typology_networks(Proposal.model_validate(fields)) == ()


def test_same_recipe_same_scenario() -> None:
    assert first_made(12) == first_made(12)


@pytest.mark.parametrize(
    ("number", "who"), [(11, "walker"), (12, "walker"), (13, "cyclist"), (14, "cyclist"), (17, "car")]
)
def test_the_actor_that_sets_off_stands_right_behind_a_van(number: int, who: str) -> None:
    scenario = first_made(number)
    van, hidden = actor(scenario, "van"), actor(scenario, who)
    gap = shapely.distance(_box(van), _box(hidden))
    assert 0.3 < gap < 2.0
    ahead = (hidden.start.x - van.start.x) * math.cos(van.start.yaw) + (hidden.start.y - van.start.y) * math.sin(
        van.start.yaw
    )
    assert ahead > van.length / 2
    assert isinstance(hidden.motion, PathMotion)
    assert isinstance(hidden.trigger, DistanceTrigger)
    way = shapely.LineString(hidden.motion.points)
    assert way.distance(shapely.LineString(scenario.egos[0].xy)) < 0.5  # it comes into the way of the first CAV


def _box(actor: Actor) -> shapely.Polygon:
    return shapely.Polygon(box_corners(actor.start.x, actor.start.y, actor.start.yaw, actor.length, actor.width))


@pytest.mark.parametrize("number", [5, 11, 12, 28, 30])
def test_vans_stand_beside_the_ways_and_in_no_building(number: int) -> None:
    for seed in range(SEEDS):
        try:
            scenario = made(number, seed)
        except ProposalRejected:
            continue
        roads = load_road_map(find_network_folder(scenario.network))
        for van in (one for one in scenario.actors if one.model == "parked-van"):
            assert not any(_box(van).intersects(building) for building in roads.building_shapes)
            assert all(_box(van).distance(shapely.LineString(ego.xy)) > 1.4 for ego in scenario.egos)
            assert all(_box(van).distance(shapely.LineString(lane.centre.xy)) > 1.4 for lane in _streets(roads))


def _streets(roads: RoadMap) -> list[Lane]:
    return [lane for lane in roads.driving if not lane.junction]


def test_stopped_lead_leaves_room_to_pass() -> None:
    scenario = first_made(26)
    car = actor(scenario, "car")
    beside = _box(car).distance(shapely.LineString(scenario.egos[0].xy))
    assert car.motion.type == "standing"
    assert 0.2 < beside < 1.0  # half a car's width reaches it, and a shift of 1.5 m passes it


def test_lead_brakes_ahead_of_the_queue() -> None:
    scenario = first_made(25)
    car = actor(scenario, "car")
    first, second = scenario.egos[:2]
    assert isinstance(car.action, HardBrake)
    away = [math.hypot(car.start.x - ego.start.x, car.start.y - ego.start.y) for ego in (first, second)]
    assert 8.0 < away[0] < away[1]


def test_waiting_van_stands_in_the_junction() -> None:
    scenario = first_made(27)
    van = actor(scenario, "van").start
    lanes = load_road_map(find_network_folder(scenario.network)).find_lanes_near(van.x, van.y, 2.0)
    assert any(lane.junction for lane in lanes)


def test_no_room_to_wait_is_refused_with_a_reason() -> None:
    reasons: list[str] = []
    for seed in range(20):
        try:
            made(27, seed)
        except ProposalRejected as rejected:
            if rejected.stage is PipelineStage.ACTORS:
                reasons.append(rejected.reason)
    assert any(reason.startswith("actor van_1: expected a lane to the left of ") for reason in reasons)


def test_other_actors_are_placed_as_in_other_categories() -> None:
    fields = proposal_of(30, 0).model_dump()
    crates = {"actor_id": "crate_1", "kind": "static_prop", "affects_vehicle": "Vehicle 1", "quantity": 2}
    proposal = Proposal.model_validate(fields | {"actors": [crates | {"group_pattern": "along_lane"}]})
    scenario = build_scenario(Recipe(id="crates", seed="0", proposal=proposal))
    assert [actor.model for actor in scenario.actors] == ["crate", "crate"]


def test_arrival_is_that_of_blind_driving_and_later_in_bends() -> None:
    straight = RouteLine(shapely.get_coordinates(shapely.segmentize(shapely.LineString([(0, 0), (80, 0)]), 1.0)), 0.0)
    for away in (4.0, 20.0, 60.0):
        assert compute_arrival_s(straight, 5.0, 5.0 + away) == pytest.approx(blind_travel_time(away), abs=0.15)
    turn = shapely.LineString(
        [(0, 0), (30, 0), *((30 + 6 * math.sin(a), 6 - 6 * math.cos(a)) for a in (0.4, 0.8, 1.2, 1.57)), (36, 50)]
    )
    bent = RouteLine(shapely.get_coordinates(shapely.segmentize(turn, 1.0)), 0.0)
    assert compute_arrival_s(bent, 5.0, 60.0) > BLIND_SPEED / BLIND_ACCELERATION / 2 + 55.0 / BLIND_SPEED + 0.3


@pytest.mark.parametrize("number", sampled((12, 25, 30), (12,)))
def test_conflicts_are_hidden_and_dangerous_but_can_be_solved(number: int) -> None:
    scenario = first_made(number, network="town_crossing" if number in (25, 30) else "")
    roads = load_road_map(find_network_folder(scenario.network))
    drives: dict[ReferenceDrive, EpisodeRecord] = {drive: drive_episode(scenario, roads, drive) for drive in DRIVES}
    scores = {drive: score_episode(episode, scenario, roads, ScoreMode.MDRIVE, 0) for drive, episode in drives.items()}
    ttc = scores["constant-speed"].min_ttc
    hidden = [
        one for drive, episode in drives.items() for one in find_occluded_intervals(drive, episode, scenario, roads)
    ]
    assert ttc is not None and ttc < 0.9
    assert scores["omniscient"].ds == 100.0
    assert OcclusionCertificate(scenario=scenario.id, hidden=tuple(hidden)).occluded
