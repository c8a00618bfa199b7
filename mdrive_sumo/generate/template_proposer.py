"""Template proposer: one function per category draws proposals that satisfy the rules, without a language model."""

import random
from collections.abc import Callable, Mapping

from mdrive_sumo.generate.category_requirements import CATEGORIES, Category
from mdrive_sumo.generate.pre_crash_typologies import draft_pre_crash
from mdrive_sumo.generate.proposal import (
    Draft,
    Maneuver,
    Proposal,
    add_followers,
    draft_ego,
    draft_relation,
    relate_followers,
)

TURN_SHARE = 0.4
"""Share of scenarios on otherwise straight routes in which one CAV turns."""
SIDE_RELATIONS = ("perpendicular_right_of", "perpendicular_left_of", "opposite_approach_of")


def propose(
    category: Category, rng: random.Random, draft_category: Callable[[random.Random], Draft] | None = None
) -> Proposal:
    """Return a proposal of the category, drawn by `rng`.

    draft_category: used instead of the category's template.
    """
    needs = CATEGORIES[category].road
    draft: Draft = {
        "category": category,
        "topology": needs.topologies[0],
        "needs_oncoming": needs.oncoming,
        "needs_multi_lane": needs.multi_lane,
        "needs_on_ramp": needs.on_ramp,
        "needs_merge": needs.merge,
    }
    return Proposal.model_validate(draft | (draft_category or TEMPLATES[category])(rng))


def _draw_count(rng: random.Random, mean: float) -> int:
    """Return a number of CAVs next to the mean, randomly rounded such that its expectation is the mean."""
    low = int(mean)
    return low + (rng.random() < mean - low)


def _add_turning_ego(egos: list[Draft], turn: Maneuver) -> list[Draft]:
    """Add a CAV that turns, from the road opposite the first one; return its relation."""
    egos.append(draft_ego(len(egos) + 1, turn))
    return [draft_relation(len(egos), "opposite_approach_of", 1)]


def _deadlock(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.7)
    turns: list[Maneuver] = [rng.choice(("left", "left", "right", "straight")) for _ in range(4)]
    relations = [draft_relation(n + 2, type_, 1) for n, type_ in enumerate(SIDE_RELATIONS)]
    queue = relate_followers(5, count, (1, 2, 3, 4), rng)
    egos = add_followers([draft_ego(n + 1, turn) for n, turn in enumerate(turns)], queue, count)
    return {
        "ego_vehicles": egos,
        "vehicle_constraints": relations + queue,
        "description": "CAVs reach an uncontrolled crossing from all sides at the same time; somebody has to yield.",
    }


def _unprotected_left(rng: random.Random) -> Draft:
    count = _draw_count(rng, 5.1)
    egos = [draft_ego(1, "left"), draft_ego(2), draft_ego(3)]
    relations = [
        draft_relation(2, "opposite_approach_of", 1),
        draft_relation(3, rng.choice(("same_lane_as", "left_lane_of")), 2),
    ]
    queue = relate_followers(4, count, (1, 2, 3), rng)
    parked = _draft_parked("Vehicle 2", rng.choice(("right_edge", "half_right"))) if rng.random() < 0.3 else []
    return {
        "ego_vehicles": add_followers(egos, queue, count),
        "vehicle_constraints": relations + queue,
        "actors": parked,
        "description": "A CAV turns left through oncoming CAVs.",
    }


def _draft_parked(vehicle: str, lateral: str, name: str = "parked_1") -> list[Draft]:
    return [
        {
            "actor_id": name,
            "kind": "parked_vehicle",
            "affects_vehicle": vehicle,
            "lateral_position": lateral,
            "speed": "stopped",
        }
    ]


def _major_minor(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.0)
    egos = [
        draft_ego(1, rng.choice(("left", "right")), entry_road="side"),
        draft_ego(2, entry_road="main"),
        draft_ego(3, rng.choice(("straight", "left")), entry_road="main"),
    ]
    relations = [draft_relation(2, "perpendicular_left_of", 1), draft_relation(3, "perpendicular_right_of", 1)]
    queue = relate_followers(4, count, (1, 2, 3), rng)
    return {
        "ego_vehicles": add_followers(egos, queue, count),
        "vehicle_constraints": relations + queue,
        "actors": _draft_parked("Vehicle 1", "right_edge") if rng.random() < 0.6 else [],
        "description": "A CAV enters the main road from the minor one, where CAVs come from both sides.",
    }


def _highway_merge(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.6)
    egos = [
        draft_ego(1, "unknown", entry_road="side"),
        draft_ego(2, entry_road="main"),
        draft_ego(3, entry_road="main"),
    ]
    relations = [
        draft_relation(1, "merges_into_lane_of", 2),
        draft_relation(3, rng.choice(("same_lane_as", "left_lane_of")), 2),
    ]
    queue = relate_followers(4, count, (1, 2, 3), rng)
    return {
        "ego_vehicles": add_followers(egos, queue, count),
        "vehicle_constraints": relations + queue,
        "description": "CAVs on the ramp and CAVs on the motorway want the same gap.",
    }


def _lane_drop(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.6)
    relations = [draft_relation(1, "merges_into_lane_of", 2), draft_relation(3, "left_lane_of", 2)]
    queue = relate_followers(4, count, (1, 2), rng)
    return {
        "ego_vehicles": add_followers([draft_ego(1), draft_ego(2), draft_ego(3)], queue, count),
        "vehicle_constraints": relations + queue,
        "description": "A lane ends; CAVs side by side have to merge one after the other.",
    }


def _lane_change(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.2)
    side = rng.choice(("left_lane_of", "right_lane_of"))
    swap = rng.random() < 0.6
    egos = [draft_ego(1, "lane_change"), draft_ego(2, "lane_change" if swap else "straight")]
    relations = [draft_relation(2, side, 1)] + ([] if swap else [draft_relation(1, "merges_into_lane_of", 2)])
    queue = relate_followers(3, count, (1, 2), rng)
    return {
        "ego_vehicles": add_followers(egos, queue, count),
        "vehicle_constraints": relations + queue,
        "description": "CAVs side by side want to change into each other's lanes.",
    }


def _blocked_lane(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.7)
    side = rng.choice(("left_lane_of", "right_lane_of"))
    relations = [draft_relation(2, side, 1)]
    queue = relate_followers(3, count, (1, 2), rng)
    kind = rng.choice(("static_prop", "parked_vehicle"))
    block = {
        "actor_id": "block_1",
        "kind": kind,
        "quantity": 1 if kind == "parked_vehicle" else rng.randint(2, 4),
        "group_pattern": "across_lane",
        "affects_vehicle": "Vehicle 1",
        "lateral_position": "center",
        "speed": "stopped",
    }
    more = [block | {"actor_id": "block_2", "kind": "static_prop", "quantity": rng.randint(1, 3)}]
    return {
        "ego_vehicles": add_followers([draft_ego(1), draft_ego(2)], queue, count),
        "vehicle_constraints": relations + queue,
        "actors": [block, *more],
        "description": "Something blocks the lane of a CAV; CAVs drive in the next lane.",
    }


def _construction(rng: random.Random) -> Draft:
    turns = rng.random() < TURN_SHARE
    count = _draw_count(rng, 4.6) - turns
    relations = [draft_relation(2, rng.choice(("left_lane_of", "right_lane_of")), 1)]
    queue = relate_followers(3, count, (1, 2), rng)
    egos = add_followers([draft_ego(1), draft_ego(2)], queue, count)
    relations += _add_turning_ego(egos, rng.choice(("left", "right"))) if turns else []
    cones = {
        "actor_id": "cones_1",
        "kind": "static_prop",
        "quantity": rng.randint(4, 5),
        "group_pattern": "diagonal",
        "start_lateral": "right_edge",
        "end_lateral": "center",
        "affects_vehicle": "Vehicle 1",
        "timing_phase": rng.choice(("on_approach", "after_exit")),
        "speed": "stopped",
    }
    barriers = cones | {"actor_id": "barriers_1", "quantity": rng.randint(2, 3), "group_pattern": "along_lane"}
    return {
        "ego_vehicles": egos,
        "vehicle_constraints": relations + queue,
        "actors": [cones, barriers],
        "description": "Cones and barriers close a lane near a crossing; two lanes of CAVs become one.",
    }


def _overtaking(rng: random.Random) -> Draft:
    count = _draw_count(rng, 3.7)
    relations = [draft_relation(2, "opposite_approach_of", 1)]
    queue = relate_followers(3, count, (1, 2), rng)
    ahead = {
        "actor_id": "stopped_1",
        "kind": rng.choice(("parked_vehicle", "static_prop")),
        "quantity": rng.randint(1, 3),
        "group_pattern": "along_lane",
        "affects_vehicle": "Vehicle 1",
        "lateral_position": rng.choice(("center", "half_right")),
        "speed": "stopped",
    }
    return {
        "ego_vehicles": add_followers([draft_ego(1), draft_ego(2)], queue, count),
        "vehicle_constraints": relations + queue,
        "actors": [ahead],
        "description": "A CAV has to pass what stands in its lane, in the lane of oncoming CAVs.",
    }


def _crosswalk(rng: random.Random) -> Draft:
    turns = rng.random() < TURN_SHARE
    count = _draw_count(rng, 3.8) - turns
    relations = [draft_relation(2, rng.choice(("opposite_approach_of", "perpendicular_right_of")), 1)]
    queue = relate_followers(3, count, (1, 2), rng)
    egos = add_followers([draft_ego(1), draft_ego(2)], queue, count)
    relations += _add_turning_ego(egos, rng.choice(("left", "right"))) if turns else []
    actors: list[Draft] = [
        {
            "actor_id": f"walker_{n}",
            "kind": "walker",
            "affects_vehicle": f"Vehicle {1 + n % 2}",
            "timing_phase": rng.choice(("on_approach", "after_exit")),
            "lateral_position": rng.choice(("sidewalk_right", "sidewalk_left")),
            "motion": "cross_perpendicular",
            "speed": rng.choice(("slow", "normal", "fast")),
        }
        for n in range(rng.randint(1, 2))
    ]
    actors += _draft_parked("Vehicle 1", "right_edge")
    return {
        "ego_vehicles": egos,
        "vehicle_constraints": relations + queue,
        "actors": actors,
        "description": "People step onto the zebra crossing from behind something that hides them.",
    }


def _roundabout(rng: random.Random) -> Draft:
    count = _draw_count(rng, 4.0)
    egos = [draft_ego(1, "left"), draft_ego(2, rng.choice(("left", "straight"))), draft_ego(3, "left")]
    relations = [draft_relation(2, "perpendicular_left_of", 1), draft_relation(3, "opposite_approach_of", 1)]
    queue = relate_followers(4, count, (1, 2, 3), rng)
    return {
        "ego_vehicles": add_followers(egos, queue, count),
        "vehicle_constraints": relations + queue,
        "description": "CAVs enter a roundabout from several arms, go around and leave it.",
    }


TEMPLATES: Mapping[Category, Callable[[random.Random], Draft]] = {
    Category.PRE_CRASH: draft_pre_crash,
    Category.BLOCKED_LANE: _blocked_lane,
    Category.CONSTRUCTION: _construction,
    Category.HIGHWAY_MERGE: _highway_merge,
    Category.LANE_CHANGE: _lane_change,
    Category.DEADLOCK: _deadlock,
    Category.MAJOR_MINOR: _major_minor,
    Category.OVERTAKING: _overtaking,
    Category.CROSSWALK: _crosswalk,
    Category.ROUNDABOUT: _roundabout,
    Category.UNPROTECTED_LEFT: _unprotected_left,
    Category.LANE_DROP: _lane_drop,
}
