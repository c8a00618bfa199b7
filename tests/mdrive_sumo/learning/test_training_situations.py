"""Situations of training scenarios on their own: what they ask for."""

import random
from functools import lru_cache

import pytest

from mdrive_sumo.learning.training_situations import MOST_CAVS, SITUATIONS, SituationPlan
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map

NETWORKS = {"roundabout": "roundabout", "merge": "lane_drop"}
"""Packaged networks that can stage a situation; main_street stages the others."""
SEEDS = range(12)


@lru_cache
def load(network: str) -> RoadMap:
    return load_road_map(find_network_folder(network))


def draw(kind: str, network: str, seed: int) -> SituationPlan | None:
    return SITUATIONS[kind].draw(load(network), random.Random(seed))


# --- situations ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", SITUATIONS)
def test_a_situation_asks_for_what_a_scenario_can_hold(kind: str) -> None:
    networks = (NETWORKS.get(kind, "main_street"), "wide_crossing", "large_roundabout", "ramp_merge", "side_street")
    plans = [draw(kind, network, seed) for network in networks for seed in SEEDS]
    drawn = [plan for plan in plans if plan is not None]
    assert len(drawn) > len(SEEDS)
    for plan in drawn:
        assert list(plan.ways) == [f"Vehicle {n}" for n in range(1, len(plan.ways) + 1)]
        assert 1 <= len(plan.ways) <= MOST_CAVS + 1
        assert 35.0 < plan.route_m[0] < plan.route_m[1]
        assert 0 <= plan.hidden_walkers <= plan.walkers
        counts = (plan.crossing_cyclists, plan.leading_cyclists, plan.parked, plan.queue, plan.traffic)
        assert min(counts) >= 0


def what_it_is_about(kind: str, plan: SituationPlan) -> bool:
    """Whether a plan has what its situation is named after."""
    first, *others = plan.ways.values()
    return {
        "lone": lambda: not others and plan == SituationPlan(plan.ways, plan.route_m),
        "meeting": lambda: len(others) >= 1,
        "oncoming-left": lambda: first.turn == "left" and len(others) + plan.traffic > 0,
        "queue": lambda: plan.queue > 0 or first.lanes[0] in {way.lanes[0] for way in others},
        "obstacle": lambda: plan.obstacles[0].affects_vehicle == "Vehicle 1",
        "walkers": lambda: plan.walkers > 0,
        "cyclists": lambda: plan.crossing_cyclists + plan.leading_cyclists > 0,
        "traffic": lambda: plan.traffic >= 3,
        "crowded": lambda: 30 < plan.crowd <= 90,
        "dense": lambda: 20 <= plan.traffic <= 84 and plan.is_jammed,
        "lane-changes": lambda: {way.entry for way in others} <= {first.entry},
        "roundabout": lambda: first.turn in ("left", "u_turn"),
        "merge": lambda: (
            len(others) > 0 and {(way.exit, way.exit_rank) for way in others} == {(first.exit, first.exit_rank)}
        ),
    }[kind]()


@pytest.mark.parametrize("kind", SITUATIONS)
def test_a_situation_has_what_its_name_says(kind: str) -> None:
    plans = [draw(kind, NETWORKS.get(kind, "main_street"), seed) for seed in SEEDS]
    assert all(plan is not None and what_it_is_about(kind, plan) for plan in plans)
    assert len({str(plan) for plan in plans}) > 3


@pytest.mark.parametrize("kind", ["oncoming-left", "lane-changes", "roundabout"])
def test_a_network_without_the_lanes_for_a_situation_stages_none(kind: str) -> None:
    """A road of one lane a direction, without a junction."""
    assert all(draw(kind, "village_street", seed) is None for seed in SEEDS)
