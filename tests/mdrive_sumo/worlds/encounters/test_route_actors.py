"""Placing: what stands in the way can be passed without driving in a lane of opposite direction."""

import math
import random
from itertools import pairwise

import numpy as np
import pytest
import shapely

from mdrive_sumo.core.geometry import boxes_corners
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.pipeline import build_scenario
from mdrive_sumo.generate.recipe import Recipe
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.generate.screening import screen_scenario
from mdrive_sumo.generate.template_proposer import propose
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.route_actors import LANE_M, NEAREST_M, PASSABLE_M, shift_to_passable


def _pose(actor: Actor) -> tuple[float, float, float]:
    return actor.start.x, actor.start.y, actor.start.yaw


def scenarios(category: Category, count: int) -> list[Scenario]:
    """Those of so many proposals that can be placed."""
    found: list[Scenario] = []
    for seed in range(count):
        key = f"{category}/{seed}"
        proposal = propose(category, random.Random(key + "/p"))
        try:
            found.append(build_scenario(Recipe(id=f"s{seed}", seed=key, proposal=proposal)))
        except ProposalRejected:
            continue
    return found


@pytest.mark.parametrize(
    ("free", "edges"),
    [
        ((False, False), (-math.inf, PASSABLE_M)),
        ((True, False), (-math.inf, 1.2)),
        ((False, True), (-1.2, math.inf)),
        ((True, True), (-math.inf, 1.2)),
    ],
)
def test_things_leave_the_side_free_on_which_they_are_passed(
    free: tuple[bool, bool], edges: tuple[float, float]
) -> None:
    offsets = [-1.0, 0.0, 1.0]
    moved = shift_to_passable(offsets, 0.8, free)
    assert min(moved) - 0.4 >= edges[0] - 1e-9
    assert max(moved) + 0.4 <= edges[1] + 1e-9
    assert sorted(abs(b - a) for a, b in pairwise(moved)) == pytest.approx([1.0, 1.0])


def test_what_stands_beside_the_lane_stays_there() -> None:
    assert shift_to_passable([-0.85 * LANE_M], 1.8, (False, True)) == [-0.85 * LANE_M]


def test_overtaking_leaves_the_left_half_of_the_lane_free_and_room_to_turn_out() -> None:
    found = scenarios(Category.OVERTAKING, 6)
    assert len(found) >= 3
    for scenario in found:
        route = shapely.LineString(scenario.egos[0].xy)
        for actor in scenario.actors:
            point = shapely.Point(actor.start.x, actor.start.y)
            along = route.project(point)
            ahead = route.interpolate(along + 0.5)
            here = route.interpolate(along)
            side = (ahead.x - here.x) * (point.y - here.y) - (ahead.y - here.y) * (point.x - here.x)
            left = math.copysign(point.distance(here), side)
            assert left + actor.width / 2 <= PASSABLE_M + 0.02
            assert along - actor.length / 2 >= NEAREST_M


@pytest.mark.slow
@pytest.mark.parametrize("category", [Category.BLOCKED_LANE, Category.CONSTRUCTION, Category.CROSSWALK])
def test_groups_do_not_stand_in_each_other(category: Category) -> None:
    for scenario in scenarios(category, 6):
        boxes = [
            shapely.Polygon(boxes_corners(*map(np.array, (*_pose(a), a.length - 0.02, a.width - 0.02))))
            for a in scenario.actors
        ]
        for i, one in enumerate(boxes):
            assert not any(one.intersects(other) for other in boxes[i + 1 :]), scenario.id


@pytest.mark.parametrize(
    "category",
    [Category.CROSSWALK, Category.BLOCKED_LANE, Category.CONSTRUCTION, Category.OVERTAKING],
)
@pytest.mark.full
def test_half_of_the_proposals_and_more_are_difficult_and_feasible(category: Category) -> None:
    found = [
        screen_scenario(scenario, load_road_map(find_network_folder(scenario.network)))
        for scenario in scenarios(category, 4)
    ]
    assert sum(one.is_difficult and one.is_feasible for one in found) >= 2
