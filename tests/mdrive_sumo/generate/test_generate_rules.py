"""Rules of a proposal: one broken proposal for each, and templates that break none."""

import random
from typing import Any

import pytest

from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.rules import RULES, find_rule_violations
from mdrive_sumo.generate.template_proposer import TEMPLATES, propose

Fields = dict[str, Any]


def ego(number: int, maneuver: str = "straight", **more: str) -> Fields:
    return {"vehicle_id": f"Vehicle {number}", "maneuver": maneuver, **more}


def relation(a: int, type_: str, b: int) -> Fields:
    return {"type": type_, "a": f"Vehicle {a}", "b": f"Vehicle {b}"}


def actor(name: str = "thing", kind: str = "static_prop", **more: Any) -> Fields:
    return {"actor_id": name, "kind": kind, "affects_vehicle": "Vehicle 1", **more}


def deadlock(**changed: Any) -> Proposal:
    fields: Fields = {
        "category": "deadlock",
        "topology": "intersection",
        "ego_vehicles": [ego(n) for n in (1, 2, 3, 4)],
        "vehicle_constraints": [
            relation(2, "opposite_approach_of", 1),
            relation(3, "perpendicular_right_of", 1),
            relation(4, "perpendicular_left_of", 1),
        ],
    }
    return Proposal.model_validate(fields | changed)


def other(category: str, **changed: Any) -> Proposal:
    """A proposal of another category with its needs, as good as empty."""
    needs = CATEGORIES[Category(category)].road
    fields: Fields = {
        "category": category,
        "topology": needs.topologies[0],
        "needs_oncoming": needs.oncoming,
        "needs_multi_lane": needs.multi_lane,
        "needs_on_ramp": needs.on_ramp,
        "needs_merge": needs.merge,
        "ego_vehicles": [ego(n) for n in (1, 2, 3, 4)],
        "vehicle_constraints": [relation(2, "left_lane_of", 1), relation(3, "opposite_approach_of", 1)],
    }
    return Proposal.model_validate(fields | changed)


BROKEN: dict[str, tuple[Proposal, str]] = {
    "_check_topology": (deadlock(topology="corridor"), "topology: expected intersection for deadlock, found corridor"),
    "_check_needs": (deadlock(needs_oncoming=True), "needs_oncoming: expected false for deadlock, found true"),
    "_check_ego_count": (deadlock(ego_vehicles=[ego(n) for n in (1, 2, 3)]), "ego_vehicles: expected 4 to 6"),
    "_check_ego_ids": (
        deadlock(ego_vehicles=[ego(n) for n in (1, 2, 4, 3)]),
        "ego_vehicles: expected the ids Vehicle 1",
    ),
    "_check_actor_count": (
        deadlock(actors=[actor("a", quantity=5), actor("b", quantity=4)]),
        "actors: expected at most 8, quantities counted, found 9",
    ),
    "_check_actor_ids": (
        deadlock(actors=[actor("a"), actor("a")]),
        "actors: expected every actor_id once, found a 2 times",
    ),
    "_check_known_ids": (
        deadlock(actors=[actor(affects_vehicle="Vehicle 9")]),
        "actor thing: affects_vehicle: expected one of the ego vehicles, found Vehicle 9",
    ),
    "_check_no_self_relation": (
        deadlock(vehicle_constraints=[relation(1, "same_lane_as", 1)]),
        "vehicle_constraints.0: expected two vehicles, found Vehicle 1 twice",
    ),
    "_check_contradictions": (
        deadlock(vehicle_constraints=[relation(1, "left_lane_of", 2), relation(2, "left_lane_of", 1)]),
        "vehicle_constraints: Vehicle 1 cannot be both left_lane_of and right_lane_of Vehicle 2",
    ),
    "_check_crossing_actors": (
        deadlock(actors=[actor(kind="npc_vehicle", motion="cross_perpendicular")]),
        "actor thing: expected a walker or cyclist to cross_perpendicular, found npc_vehicle",
    ),
    "_check_static_actors": (
        deadlock(actors=[actor(motion="straight_line")]),
        "actor thing: expected a static_prop to be static, found straight_line",
    ),
    "_check_conflict_relation": (
        deadlock(vehicle_constraints=[relation(1, "same_exit_as", 2)]),
        "vehicle_constraints: expected at least one of left_lane_of",
    ),
    "_check_oncoming_relation": (
        other("overtaking", vehicle_constraints=[relation(2, "same_lane_as", 1)]),
        "vehicle_constraints: expected opposite_approach_of because of needs_oncoming, found none",
    ),
    "_check_lane_relation": (
        other("blocked-lane", vehicle_constraints=[relation(2, "opposite_approach_of", 1)]),
        "vehicle_constraints: expected a lane relation because of needs_multi_lane, found none",
    ),
    "_check_merge_relation": (
        other("lane-drop"),
        "vehicle_constraints: expected merges_into_lane_of because of the merge, found none",
    ),
    "_check_ramp_roads": (
        other("highway-merge"),
        "ego_vehicles: expected one main and one side entry_road for the ramp",
    ),
    "_check_unprotected_left": (
        other("unprotected-left"),
        "ego_vehicles: expected a left turn opposite a straight drive",
    ),
    "_check_walkers": (other("crosswalk"), "actors: expected at least one walker for crosswalk, found none"),
    "_check_no_lane_change": (
        other("blocked-lane", ego_vehicles=[ego(1, "lane_change"), ego(2), ego(3)]),
        "ego_vehicles: expected no lane_change for blocked-lane, found Vehicle 1",
    ),
    "_check_overtaking": (
        other("overtaking"),
        "actors: expected something parked on the lane of Vehicle 1 for overtaking",
    ),
    "_check_typology": (deadlock(pre_crash=30), "pre_crash: expected none for deadlock, found 30"),
}


def test_the_base_of_this_table_is_valid() -> None:
    assert find_rule_violations(deadlock()) == ()


def test_every_rule_has_a_proposal_that_breaks_it() -> None:
    assert {rule.__name__ for rule in RULES} == set(BROKEN)


@pytest.mark.parametrize("rule", sorted(BROKEN))
def test_a_broken_rule_is_told_in_a_sentence(rule: str) -> None:
    proposal, sentence = BROKEN[rule]
    told = next(one for one in RULES if one.__name__ == rule)(proposal)
    assert any(problem.startswith(sentence) for problem in told)
    assert any(problem.startswith(sentence) for problem in find_rule_violations(proposal))


@pytest.mark.parametrize("category", sorted(TEMPLATES))
def test_templates_keep_the_rules(category: Category) -> None:
    for seed in range(40):
        assert find_rule_violations(propose(category, random.Random(seed))) == ()
