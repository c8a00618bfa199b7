"""Pre-crash scenarios: typologies of NHTSA that a junction or street can stage, and a template for each.

Numbers: Najm, Smith, Yanagisawa, Pre-Crash Scenario Typology for Crash Avoidance Research, DOT HS 810 767 (2007), 37
typologies in the order of its list; names are our own words. Those left out need what a flat road with scripted road
users has not got (vehicle failure 1, loss of control 2 and 3, road edge departure 6 to 8, animals 9 and 10, drifting
18), are a category of the bucket of their own (changing lanes 17, objects 35 and 36), or leave no way out for anybody
(oncoming vehicles 20 and 21).
"""

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.generate.category import Topology
from mdrive_sumo.generate.proposal import Proposal

Draft = dict[str, Any]
"""Fields of a proposal before they are checked."""
HOUSES = ("old_town", "school_crossing", "staggered", "town_crossing")
"""Crossings with houses or hedges at the corners."""
THREE_ARMS = ("minor_road", "side_street")


@dataclass(frozen=True, slots=True)
class Typology:
    """One line of the list, as it is staged here."""

    name: str
    who: str
    """Who conflicts."""
    draft: Callable[[random.Random], Draft]
    crops: tuple[str, ...]
    """Networks on which it is staged."""


def draft(rng: random.Random) -> Draft:
    """Fields of a pre-crash proposal of some typology."""
    number = rng.choice(sorted(TYPOLOGIES))
    return draft_of(number, rng)


def draft_of(number: int, rng: random.Random) -> Draft:
    """Fields of a proposal of this typology."""
    typology = TYPOLOGIES[number]
    said = f"NHTSA pre-crash typology {number}, {typology.name}: {typology.who}."
    return {"topology": Topology.INTERSECTION, "pre_crash": number, "description": said} | typology.draft(rng)


def crops_of(proposal: Proposal) -> tuple[str, ...]:
    """Networks for the proposal's typology; none if it is not one that we stage ourselves."""
    typology = TYPOLOGIES.get(proposal.pre_crash or 0)
    return tuple(typology.crops) if typology else ()


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


def _car(phase: str, speed: str, **more: str) -> Draft:
    """A car without V2X on its lane."""
    return {
        "actor_id": "car_1",
        "kind": "npc_vehicle",
        "affects_vehicle": "Vehicle 1",
        "timing_phase": phase,
        "motion": "follow_lane",
        "speed": speed,
    } | more


def _side(rng: random.Random) -> str:
    return rng.choice(("perpendicular_right_of", "perpendicular_left_of"))


def _crossing(kind: str, turning: bool) -> Callable[[random.Random], Draft]:
    """Somebody steps or rides from behind a van into the way of a CAV; another one comes toward it."""

    def made(rng: random.Random) -> Draft:
        turn = rng.choice(("left", "right")) if turning else "straight"
        phase = "after_turn" if turning else "after_exit"
        other = rng.choice(("straight", "left"))
        speed = rng.choice(("normal", "fast"))
        return {
            "ego_vehicles": _egos(turn, other),
            "vehicle_constraints": [_relation(2, "opposite_approach_of" if not turning else _side(rng), 1)],
            "actors": [_crosser(kind, phase, speed), _van(1, phase)],
        }

    return made


def _left_across(rng: random.Random) -> Draft:
    actors = [_van(rng.choice((1, 2)), rng.choice(("on_approach", "after_exit")))]
    return {
        "ego_vehicles": _egos("left", rng.choice(("straight", "right"))),
        "vehicle_constraints": [_relation(2, "opposite_approach_of", 1)],
        "needs_oncoming": True,
        "actors": actors,
    }


def _right_turn(rng: random.Random) -> Draft:
    second = rng.choice((("straight", "perpendicular_left_of"), ("left", "opposite_approach_of")))
    relations = [_relation(2, second[1], 1), _relation(1, "same_exit_as", 2)]
    return {"ego_vehicles": _egos("right", second[0]), "vehicle_constraints": relations, "actors": [_van(1)]}


def _straight_paths(rng: random.Random) -> Draft:
    third = rng.random() < 0.3
    relations = [_relation(2, _side(rng), 1)] + [_relation(3, "opposite_approach_of", 1)] * third
    turns = ["straight", "straight"] + [rng.choice(("left", "right"))] * third
    return {"ego_vehicles": _egos(*turns), "vehicle_constraints": relations, "actors": [_van(rng.choice((1, 2)))]}


def _turning(rng: random.Random) -> Draft:
    third = rng.random() < 0.3
    side = _side(rng)
    relations = [_relation(2, side, 1)] + [_relation(3, "opposite_approach_of", 2)] * third
    turns = [rng.choice(("left", "left", "right")), rng.choice(("straight", "left"))] + ["straight"] * third
    return {"ego_vehicles": _egos(*turns), "vehicle_constraints": relations, "actors": [_van(rng.choice((1, 2)))]}


def _runs_sign(rng: random.Random) -> Draft:
    return {
        "topology": Topology.T_JUNCTION,
        "ego_vehicles": _egos(rng.choice(("straight", "left")), "straight"),
        "vehicle_constraints": [_relation(2, "opposite_approach_of", 1)],
        "actors": [_car("in_intersection", "normal", crossing_direction="right")],
    }


def _lead(stopped: bool) -> Callable[[random.Random], Draft]:
    def made(rng: random.Random) -> Draft:
        phase, speed = ("after_turn", "stopped") if stopped else ("on_approach", "erratic")
        turn = rng.choice(("left", "right"))
        second: Sequence[Draft] = [_relation(2, "same_lane_as", 1), _relation(2, "follow_route_of", 1)]
        other: Sequence[Draft] = [_relation(2, _side(rng), 1)]
        follows = not stopped or rng.random() < 0.5
        return {
            "ego_vehicles": _egos(turn, turn if follows else "left"),
            "vehicle_constraints": second if follows else other,
            "actors": [_car(phase, speed, direction_relative_to="same")],
        }

    return made


def _pulls_out(rng: random.Random) -> Draft:
    turn = rng.choice(("left", "right"))
    return {
        "ego_vehicles": _egos(turn, rng.choice(("straight", "left"))),
        "vehicle_constraints": [_relation(2, _side(rng), 1)],
        "actors": [
            _car("after_turn", "slow", direction_relative_to="same", lateral_position="offroad_right"),
            _van(1, "after_turn"),
        ],
    }


TYPOLOGIES: Mapping[int, Typology] = {
    5: Typology("running a stop sign", "a car leaves the minor road without stopping", _runs_sign, ("minor_road",)),
    11: Typology("pedestrian, vehicle manoeuvring", "a CAV that turns and a walker", _crossing("walker", True), HOUSES),
    12: Typology("pedestrian, vehicle going on", "a CAV and a walker", _crossing("walker", False), HOUSES),
    13: Typology("cyclist, vehicle manoeuvring", "a CAV that turns and a cyclist", _crossing("cyclist", True), HOUSES),
    14: Typology("cyclist, vehicle going on", "a CAV and a cyclist", _crossing("cyclist", False), HOUSES),
    19: Typology("vehicle parking, same direction", "a CAV and a car that leaves its parking place", _pulls_out, HOUSES),
    25: Typology("lead vehicle decelerating", "CAVs in a queue and a car that brakes hard", _lead(False), HOUSES),
    26: Typology("lead vehicle stopped", "a CAV and a car that stands behind the corner", _lead(True), HOUSES),
    27: Typology(
        "left turn across path, opposite directions, signals",
        "a CAV that turns left and an oncoming one",
        _left_across,
        ("main_street", "town_crossing"),
    ),
    28: Typology(
        "right turn at signals", "a CAV that turns right and one in the same exit", _right_turn, ("main_street", "town_crossing")
    ),
    29: Typology(
        "left turn across path, opposite directions, no signals",
        "a CAV that turns left and an oncoming one",
        _left_across,
        ("old_town", "school_crossing", "staggered"),
    ),
    30: Typology("straight crossing paths, no signals", "CAVs from two roads, both straight on", _straight_paths, HOUSES),
    31: Typology("turning, no signals", "a CAV that turns and one on the other road", _turning, HOUSES),
}
