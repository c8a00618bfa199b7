"""Pre-crash scenarios: typologies of NHTSA that a junction or street can stage, and a template for each.

Numbers: Najm, Smith, Yanagisawa, Pre-Crash Scenario Typology for Crash Avoidance Research, DOT HS 810 767 (2007), 37
typologies in the order of its list; names are our own words. Numbers are from knowledge of the list; the report itself
was not at hand to check them against. Left out are those that
- need what a flat road with scripted road users has not got: vehicle failure 1, loss of control 2 and 3, leaving the
  road 6 to 8, animals 9 and 10, drifting 19; running a red light 4, for lights are at rest;
- are other categories of the bucket: changing lanes 18, objects 35 and 36;
- leave no way out for anybody: oncoming vehicles 20 and 21;
- are much like one that is here: backing up 15 (17), turning side by side 16 (28), other leads 22 to 24 (25 and 26);
- name no conflict: evasive action 32 and 33, incidents without a collision 34, all others 37.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.generate.category_requirements import Topology
from mdrive_sumo.generate.proposal import Proposal

Draft = dict[str, Any]
"""Fields of a proposal before they are checked."""
HOUSES = ("old_town", "old_town", "school_crossing", "town_crossing", "town_crossing")
"""Crossings with houses or hedges at the corners; what is named more often is taken more often."""
BENDS = ("old_town", "old_town", "old_town", "school_crossing")
STRAIGHT = ("quiet_crossing", "school_crossing", "town_crossing", "town_crossing")
"""Crossings of straight streets."""


@dataclass(frozen=True, slots=True)
class PreCrashTypology:
    """One line of the list, as it is staged here."""

    name: str
    participants: str
    """Who conflicts."""
    draft: Callable[[random.Random], Draft]
    networks: tuple[str, ...]
    """Networks on which it is staged."""


def draft_pre_crash(rng: random.Random) -> Draft:
    """Fields of a pre-crash proposal of some typology."""
    number = rng.choice(sorted(TYPOLOGIES))
    return draft_typology(number, rng)


def draft_typology(number: int, rng: random.Random) -> Draft:
    """Fields of a proposal of this typology."""
    typology = TYPOLOGIES[number]
    said = f"NHTSA pre-crash typology {number}, {typology.name}: {typology.participants}."
    return {"topology": Topology.INTERSECTION, "pre_crash": number, "description": said} | typology.draft(rng)


def find_typology_networks(proposal: Proposal) -> tuple[str, ...]:
    """Networks for the proposal's typology; none if it is not one that we stage ourselves."""
    typology = TYPOLOGIES.get(proposal.pre_crash or 0)
    return tuple(typology.networks) if typology else ()


def _egos(*turns: str) -> list[Draft]:
    return [{"vehicle_id": f"Vehicle {n}", "maneuver": turn} for n, turn in enumerate(turns, 1)]


def _relation(a: int, type_: str, b: int) -> Draft:
    return {"type": type_, "a": f"Vehicle {a}", "b": f"Vehicle {b}"}


def _van(vehicle: int = 1, phase: str = "on_approach") -> Draft:
    """A van at the roadside; one in the phase of somebody who sets off stands so that it hides that one."""
    return {
        "actor_id": f"van_{vehicle}",
        "kind": "parked_vehicle",
        "affects_vehicle": f"Vehicle {vehicle}",
        "timing_phase": phase,
        "lateral_position": "offroad_right",
        "speed": "stopped",
    }


def _crosser(kind: str, phase: str, speed: str) -> Draft:
    """Somebody who crosses the way of Vehicle 1 from the right-hand kerb."""
    return {
        "actor_id": f"{kind}_1",
        "kind": kind,
        "affects_vehicle": "Vehicle 1",
        "timing_phase": phase,
        "lateral_position": "sidewalk_right",
        "motion": "cross_perpendicular",
        "crossing_direction": "right",
        "speed": speed,
    }


def _car(phase: str, speed: str, vehicle: int = 1) -> Draft:
    """Somebody without V2X ahead on the lane of a CAV."""
    return {
        "actor_id": "car_1" if vehicle == 1 else "van_1",
        "kind": "npc_vehicle",
        "affects_vehicle": f"Vehicle {vehicle}",
        "timing_phase": phase,
        "motion": "follow_lane",
        "speed": speed,
        "direction_relative_to": "same",
    }


def _side(rng: random.Random) -> str:
    return rng.choice(("perpendicular_right_of", "perpendicular_left_of"))


def _turn_and_witness(rng: random.Random) -> Draft:
    """A CAV turns into the road out of which another one comes, which sees what happens there."""
    turn, side, back = rng.choice(
        (("left", "perpendicular_left_of", "right"), ("right", "perpendicular_right_of", "left"))
    )
    return {"ego_vehicles": _egos(turn, back), "vehicle_constraints": [_relation(2, side, 1)]}


def _crossing(kind: str, turning: bool) -> Callable[[random.Random], Draft]:
    """Somebody steps or rides from behind a van into the way of a CAV; another one comes toward it."""

    def made(rng: random.Random) -> Draft:
        phase = "after_turn" if turning else "after_exit"
        oncoming = {
            "ego_vehicles": _egos("straight", rng.choice(("straight", "right", "right", "right"))),
            "vehicle_constraints": [_relation(2, "opposite_approach_of", 1)],
        }
        speed = rng.choice(("normal", "fast"))
        cavs = _turn_and_witness(rng) if turning else oncoming
        return cavs | {"actors": [_crosser(kind, phase, speed), _van(1, phase)]}

    return made


def _left_across_signals(rng: random.Random) -> Draft:
    """A van waits to turn left, beside the oncoming CAV."""
    waiting = _car("on_approach", "stopped", vehicle=2) | {"motion": "static", "lateral_position": "left_edge"}
    return {
        "ego_vehicles": _egos("left", rng.choice(("straight", "straight", "right"))),
        "vehicle_constraints": [_relation(2, "opposite_approach_of", 1)],
        "needs_oncoming": True,
        "actors": [waiting],
    }


def _left_across(rng: random.Random) -> Draft:
    """A van drives before the oncoming CAV."""
    return {
        "ego_vehicles": _egos("left", rng.choice(("straight", "right", "right"))),
        "vehicle_constraints": [_relation(2, "opposite_approach_of", 1)],
        "needs_oncoming": True,
        "actors": [_car("in_intersection", "normal", vehicle=2)],
    }


def _right_turn(rng: random.Random) -> Draft:
    """A CAV turns right into the lane of one that comes from its left."""
    third = rng.random() < 0.3
    relations = [_relation(2, "perpendicular_right_of", 1), _relation(2, "merges_into_lane_of", 1)]
    relations += [_relation(3, "opposite_approach_of", 2)] * third
    egos = _egos(*["straight", "right", "left"][: 2 + third])
    return {"ego_vehicles": egos, "vehicle_constraints": relations, "actors": [_van(1)]}


def _straight_paths(rng: random.Random) -> Draft:
    side, third = _side(rng), rng.random() < 0.5
    relations = [_relation(2, side, 1)] + [_relation(3, "opposite_approach_of", 1)] * third
    turns = ["straight", "straight"] + [rng.choice(("left", "right"))] * third
    return {"ego_vehicles": _egos(*turns), "vehicle_constraints": relations, "actors": _maybe_van(side, rng)}


def _turning(rng: random.Random) -> Draft:
    side, third = _side(rng), rng.random() < 0.4
    relations = [_relation(2, side, 1)] + [_relation(3, "opposite_approach_of", 2)] * third
    turns = [rng.choice(("left", "left", "right")), rng.choice(("straight", "left", "left"))] + [
        rng.choice(("left", "straight"))
    ] * third
    return {"ego_vehicles": _egos(*turns), "vehicle_constraints": relations, "actors": _maybe_van(side, rng)}


def _maybe_van(side: str, rng: random.Random) -> list[Draft]:
    """Houses alone hide CAVs from each other; a van is there in every other scenario."""
    return [_van(_sees_right(side))] if rng.random() < 0.5 else []


def _sees_right(side: str) -> int:
    """Which of the first two CAVs has the other one on its right: a van at its kerb hides them from each other."""
    return 1 if side == "perpendicular_right_of" else 2


def _runs_sign(rng: random.Random) -> Draft:
    """A CAV behind the van that runs the sign sees it; one on the main road does not."""
    passes = rng.random() < 0.6
    turns = "straight" if passes else "left", rng.choice(("left", "right"))
    egos = [ego | {"entry_road": road} for ego, road in zip(_egos(*turns), ("main", "side"), strict=True)]
    side = "perpendicular_right_of" if passes else "perpendicular_left_of"
    return {
        "topology": Topology.T_JUNCTION,
        "ego_vehicles": egos,
        "vehicle_constraints": [_relation(2, side, 1)],
        "actors": [_car("in_intersection", "normal", vehicle=2) | {"actor_id": "van_2"}] + [_van(1)] * passes,
    }


def _lead_braking(rng: random.Random) -> Draft:
    """The first CAV of a queue hides the car ahead from the second one."""
    turn = rng.choice(("left", "right"))
    relations = [_relation(2, "same_lane_as", 1), _relation(2, "follow_route_of", 1)]
    return {
        "ego_vehicles": _egos(turn, turn),
        "vehicle_constraints": relations,
        "actors": [_car("on_approach", "erratic")],
    }


def _lead_stopped(rng: random.Random) -> Draft:
    """The car stands half beside the lane, so that one can pass it."""
    stopped = _car("after_turn", "stopped") | {"motion": "static", "lateral_position": "half_right"}
    return _turn_and_witness(rng) | {"actors": [stopped]}


def _pulls_out(rng: random.Random) -> Draft:
    leaving = _car("after_turn", "slow") | {"lateral_position": "offroad_right"}
    return _turn_and_witness(rng) | {"actors": [leaving, _van(1, "after_turn")]}


TYPOLOGIES: Mapping[int, PreCrashTypology] = {
    5: PreCrashTypology(
        "running a stop sign", "a van leaves the minor road without stopping", _runs_sign, ("minor_road",)
    ),
    11: PreCrashTypology(
        "pedestrian, vehicle manoeuvring", "a CAV that turns and a walker", _crossing("walker", True), HOUSES
    ),
    12: PreCrashTypology("pedestrian, vehicle going on", "a CAV and a walker", _crossing("walker", False), BENDS),
    13: PreCrashTypology(
        "cyclist, vehicle manoeuvring", "a CAV that turns and a cyclist", _crossing("cyclist", True), HOUSES
    ),
    14: PreCrashTypology("cyclist, vehicle going on", "a CAV and a cyclist", _crossing("cyclist", False), BENDS),
    17: PreCrashTypology(
        "vehicle parking, same direction", "a CAV and a car that leaves its parking place", _pulls_out, HOUSES
    ),
    25: PreCrashTypology(
        "lead vehicle decelerating",
        "CAVs in a queue and a car that brakes hard",
        _lead_braking,
        STRAIGHT,
    ),
    26: PreCrashTypology(
        "lead vehicle stopped", "a CAV and a car that stands behind the corner", _lead_stopped, STRAIGHT
    ),
    27: PreCrashTypology(
        "left turn across path, opposite directions, signals",
        "a CAV that turns left and an oncoming one",
        _left_across_signals,
        ("boulevard", "main_street"),
    ),
    28: PreCrashTypology(
        "right turn at signals",
        "a CAV that turns right and one in the same exit",
        _right_turn,
        ("main_street",),
    ),
    29: PreCrashTypology(
        "left turn across path, opposite directions, no signals",
        "a CAV that turns left and an oncoming one",
        _left_across,
        ("old_town", "old_town", "quiet_crossing", "school_crossing"),
    ),
    30: PreCrashTypology(
        "straight crossing paths, no signals",
        "CAVs from two roads, both straight on",
        _straight_paths,
        ("town_crossing", "school_crossing"),
    ),
    31: PreCrashTypology("turning, no signals", "a CAV that turns and one on the other road", _turning, HOUSES),
}
