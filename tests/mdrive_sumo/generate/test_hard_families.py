"""Scenario families of the hard tier: sound scenarios, equal ones from equal candidates, bounds refused."""

import random
from collections.abc import Sequence
from functools import lru_cache

import pytest
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.families import FAMILIES
from mdrive_sumo.generate.hard.family import BUCKET, FamilyCandidate, ScenarioFamily, load_network
from mdrive_sumo.generate.hard.passage_pedestrian import DEEP_M, STREETS, WALL_M, PassageStreet, find_passages
from mdrive_sumo.generate.network_choice import is_hard_tier
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.roads import find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.worlds.placement.cavs import NoRoomError
from mdrive_sumo.worlds.placement.lane_chains import compute_pose

POINTS = 5
MOST_CAVS, MOST_VEHICLES = 12, 150
"""Of a scenario of the hard tier (issue K)."""


def draw_candidate(family: ScenarioFamily, k: int) -> FamilyCandidate:
    rng = random.Random(f"{family.category}/{k}")
    values = tuple(rng.uniform(one.low, one.high) for one in family.parameters)
    return FamilyCandidate(f"{family.category}_{k}", values, f"seed{k}")


@lru_cache(maxsize=64)
def build_samples(category: str) -> tuple[Scenario, ...]:
    made: list[Scenario] = []
    for k in range(POINTS):
        try:
            made.append(FAMILIES[category].build(draw_candidate(FAMILIES[category], k)))
        except (ProposalRejected, NoRoomError):
            continue
    return tuple(made)


@pytest.mark.parametrize("category", FAMILIES)
def test_most_points_make_sound_scenarios(category: str) -> None:
    made = build_samples(category)
    assert len(made) >= POINTS - 1
    for scenario in made:
        roads = load_road_map(find_network_folder(scenario.network))
        check_scenario(scenario, roads)
        assert list(find_spawn_overlaps(scenario, roads)) == []
        assert (scenario.bucket, scenario.category, scenario.speeds) == (BUCKET, category, "road")
        assert 2 <= len(scenario.egos) <= MOST_CAVS
        assert len(scenario.background.vehicles) <= MOST_VEHICLES
        assert all(ego.time_limit_s is None for ego in scenario.egos)


@pytest.mark.parametrize("category", FAMILIES)
def test_equal_candidates_make_equal_scenarios(category: str) -> None:
    first, again = build_samples(category)[0], draw_candidate(FAMILIES[category], 0)
    assert FAMILIES[category].build(again) == first
    assert {scenario.id for scenario in build_samples(category)} <= {f"{category}_{k}" for k in range(POINTS)}


@pytest.mark.parametrize("category", FAMILIES)
def test_another_seed_makes_other_traffic(category: str) -> None:
    family = FAMILIES[category]
    sample = next(iter(build_samples(category)))
    drawn = draw_candidate(family, int(sample.id.rsplit("_", 1)[1])).values
    values = tuple(
        one.high if "reactive" in one.meaning else value for one, value in zip(family.parameters, drawn, strict=True)
    )
    one, other = (family.build(FamilyCandidate("x", values, seed)).background for seed in ("a", "b"))
    assert one != other


@pytest.mark.parametrize("category", FAMILIES)
def test_the_corners_of_the_bounds_are_inside(category: str) -> None:
    """Every value at its low or high end: sound, or refused for a reason, but never another error."""
    family = FAMILIES[category]
    for ends in (lambda one: one.low, lambda one: one.high):
        try:
            family.build(FamilyCandidate("x", tuple(ends(one) for one in family.parameters), "a"))
        except ProposalRejected as refused:
            assert refused.reason


def spoil(values: Sequence[float], family: ScenarioFamily, kind: str) -> tuple[float, ...]:
    first = family.parameters[0]
    replaced = {"below": first.low - 0.1, "above": first.high + 0.1, "nan": float("nan")}
    return tuple(values[1:]) if kind == "missing" else (replaced[kind], *values[1:])


@pytest.mark.parametrize("kind", ["below", "above", "nan", "missing"])
@pytest.mark.parametrize("category", FAMILIES)
def test_values_out_of_bounds_are_refused(category: str, kind: str) -> None:
    good = draw_candidate(FAMILIES[category], 0)
    bad = FamilyCandidate(good.scenario_id, spoil(good.values, FAMILIES[category], kind), good.seed)
    with pytest.raises(InputError, match=f"{category}: .*expected .*, found "):
        FAMILIES[category].build(bad)


def test_families_are_distinct_and_their_networks_belong_to_the_tier_alone() -> None:
    assert all(family.category == category for category, family in FAMILIES.items())
    used = {scenario.network for category in FAMILIES for scenario in build_samples(category)}
    assert all(is_hard_tier(network) for network in used)
    assert not any(is_hard_tier(scenario.network) for scenario in load_suite("interaction@0").scenarios)


@pytest.mark.parametrize("street", STREETS, ids=lambda street: street.own[0])
def test_riders_come_through_free_passages_past_a_wall(street: PassageStreet) -> None:
    roads = load_network(street.network)
    lanes = find_lane_path(roads, *street.own)
    houses = shapely.union_all(roads.building_shapes)
    passages = find_passages(roads, lanes)
    assert len(passages) >= 3
    for station in passages:
        begin, end = (compute_pose(roads, lanes, station, offset) for offset in (-DEEP_M, street.across_m))
        way = shapely.LineString([(begin.x, begin.y), (end.x, end.y)])
        assert houses.distance(way) > 0.3  # half the width of a rider
        before = compute_pose(roads, lanes, station - 1.5, -WALL_M - 0.2)
        assert houses.contains(shapely.Point(before.x, before.y))
