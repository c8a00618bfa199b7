"""Pre-crash scenarios: typologies of NHTSA that a junction or street can stage, and a template for each.

Numbers: Najm, Smith, Yanagisawa, Pre-Crash Scenario Typology for Crash Avoidance Research, DOT HS 810 767 (2007), 37
typologies in the order of its list; names are our own words. Numbers are from knowledge of the list; the report itself
was not at hand to check them against. Left out are those that
- need what a flat road with scripted road users has not got: vehicle failure 1, loss of control 2 and 3, leaving the
  road 6 to 8, animals 9 and 10, drifting 19; running a red light 4, for scripted road users know no lights;
- are other categories of the bucket: changing lanes 18, objects 35 and 36;
- leave no way to avoid a collision: oncoming vehicles 20 and 21;
- are much like one that is here: backing up 15 (17), turning side by side 16 (28), other leads 22 to 24 (25 and 26);
- name no conflict: evasive action 32 and 33, incidents without a collision 34, all others 37.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from mdrive_sumo.generate.proposal import Draft, Proposal, draft_relation
from mdrive_sumo.worlds.network_features import Topology

HOUSES = ("old_town", "old_town", "school_crossing", "town_crossing", "town_crossing")
"""Crossings with houses or hedges at the corners; repeated names are chosen more often."""
BENDS = ("old_town", "old_town", "old_town", "school_crossing")
AT_SIGNALS = (27, 28)
"""Typologies whose name has signals."""
STRAIGHT = ("quiet_crossing", "school_crossing", "town_crossing", "town_crossing")
"""Crossings of straight streets."""


@dataclass(frozen=True, slots=True)
class PreCrashTypology:
    """One typology of the list and its template."""

    name: str
    participants: str
    """The road users in conflict."""
    draft: Callable[[random.Random], Draft]
    networks: tuple[str, ...]
    """Networks for the template."""


def draft_pre_crash(rng: random.Random) -> Draft:
    """Return the fields of a pre-crash proposal of a random typology."""
    return draft_typology(rng.choice(sorted(TYPOLOGIES)), rng)


def draft_pre_crash_at_signals(rng: random.Random) -> Draft:
    """Return the fields of a pre-crash proposal of a typology at signals."""
    return draft_typology(rng.choice(AT_SIGNALS), rng)


def draft_pre_crash_without_signals(rng: random.Random) -> Draft:
    """Return the fields of a pre-crash proposal of a typology that needs no signals."""
    return draft_typology(rng.choice(sorted(set(TYPOLOGIES) - set(AT_SIGNALS))), rng)


def draft_typology(number: int, rng: random.Random) -> Draft:
    """Return the fields of a proposal of this typology."""
    typology = TYPOLOGIES[number]
    said = f"NHTSA pre-crash typology {number}, {typology.name}: {typology.participants}."
    return {"topology": Topology.INTERSECTION, "pre_crash": number, "description": said} | typology.draft(rng)


def find_typology_networks(proposal: Proposal) -> tuple[str, ...]:
    """Return the networks for the proposal's typology; empty if there is no template for it."""
    typology = TYPOLOGIES.get(proposal.pre_crash or 0)
    return tuple(typology.networks) if typology else ()


def _draft_egos(*turns: str) -> list[Draft]:
    return [{"vehicle_id": f"Vehicle {n}", "maneuver": turn} for n, turn in enumerate(turns, 1)]


def _draft_van(vehicle: int = 1, phase: str = "on_approach") -> Draft:
    """A van at the roadside; in the phase of a crossing actor it stands so that it hides that actor."""
    return {
        "actor_id": f"van_{vehicle}",
        "kind": "parked_vehicle",
        "affects_vehicle": f"Vehicle {vehicle}",
        "timing_phase": phase,
        "lateral_position": "offroad_right",
        "speed": "stopped",
    }


def _draft_crosser(kind: str, phase: str, speed: str) -> Draft:
    """An actor that crosses the route of Vehicle 1 from the right-hand kerb."""
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


def _draft_car(phase: str, speed: str, vehicle: int = 1) -> Draft:
    """A vehicle without V2X ahead on the lane of a CAV."""
    return {
        "actor_id": "car_1" if vehicle == 1 else "van_1",
        "kind": "npc_vehicle",
        "affects_vehicle": f"Vehicle {vehicle}",
        "timing_phase": phase,
        "motion": "follow_lane",
        "speed": speed,
        "direction_relative_to": "same",
    }


def _draw_side(rng: random.Random) -> str:
    return rng.choice(("perpendicular_right_of", "perpendicular_left_of"))


def _draft_turn_and_witness(rng: random.Random) -> Draft:
    """A CAV turns into the road from which another one comes, which observes what happens there."""
    turn, side, back = rng.choice(
        (("left", "perpendicular_left_of", "right"), ("right", "perpendicular_right_of", "left"))
    )
    return {"ego_vehicles": _draft_egos(turn, back), "vehicle_constraints": [draft_relation(2, side, 1)]}


def _make_crossing_draft(kind: str, turning: bool) -> Callable[[random.Random], Draft]:
    """An actor steps or rides from behind a van into the path of a CAV; another CAV comes towards it."""

    def made(rng: random.Random) -> Draft:
        phase = "after_turn" if turning else "after_exit"
        oncoming = {
            "ego_vehicles": _draft_egos("straight", rng.choice(("straight", "right", "right", "right"))),
            "vehicle_constraints": [draft_relation(2, "opposite_approach_of", 1)],
        }
        speed = rng.choice(("normal", "fast"))
        cavs = _draft_turn_and_witness(rng) if turning else oncoming
        return cavs | {"actors": [_draft_crosser(kind, phase, speed), _draft_van(1, phase)]}

    return made


def _draft_left_across_signals(rng: random.Random) -> Draft:
    """A van waits to turn left, beside the oncoming CAV."""
    waiting = _draft_car("on_approach", "stopped", vehicle=2) | {"motion": "static", "lateral_position": "left_edge"}
    return {
        "ego_vehicles": _draft_egos("left", rng.choice(("straight", "straight", "right"))),
        "vehicle_constraints": [draft_relation(2, "opposite_approach_of", 1)],
        "needs_oncoming": True,
        "actors": [waiting],
    }


def _draft_left_across(rng: random.Random) -> Draft:
    """A van drives ahead of the oncoming CAV."""
    return {
        "ego_vehicles": _draft_egos("left", rng.choice(("straight", "right", "right"))),
        "vehicle_constraints": [draft_relation(2, "opposite_approach_of", 1)],
        "needs_oncoming": True,
        "actors": [_draft_car("in_intersection", "normal", vehicle=2)],
    }


def _draft_right_turn(rng: random.Random) -> Draft:
    """A CAV turns right into the lane of one that comes from its left."""
    third = rng.random() < 0.3
    relations = [draft_relation(2, "perpendicular_right_of", 1), draft_relation(2, "merges_into_lane_of", 1)]
    relations += [draft_relation(3, "opposite_approach_of", 2)] * third
    egos = _draft_egos(*["straight", "right", "left"][: 2 + third])
    return {"ego_vehicles": egos, "vehicle_constraints": relations, "actors": [_draft_van(1)]}


def _draft_straight_paths(rng: random.Random) -> Draft:
    side, third = _draw_side(rng), rng.random() < 0.5
    relations = [draft_relation(2, side, 1)] + [draft_relation(3, "opposite_approach_of", 1)] * third
    turns = ["straight", "straight"] + [rng.choice(("left", "right"))] * third
    return {"ego_vehicles": _draft_egos(*turns), "vehicle_constraints": relations, "actors": _draw_van(side, rng)}


def _draft_turning(rng: random.Random) -> Draft:
    side, third = _draw_side(rng), rng.random() < 0.4
    relations = [draft_relation(2, side, 1)] + [draft_relation(3, "opposite_approach_of", 2)] * third
    turns = [rng.choice(("left", "left", "right")), rng.choice(("straight", "left", "left"))] + [
        rng.choice(("left", "straight"))
    ] * third
    return {"ego_vehicles": _draft_egos(*turns), "vehicle_constraints": relations, "actors": _draw_van(side, rng)}


def _draw_van(side: str, rng: random.Random) -> list[Draft]:
    """Houses alone hide CAVs from each other; every other scenario has a van."""
    return [_draft_van(_vehicle_with_other_on_right(side))] if rng.random() < 0.5 else []


def _vehicle_with_other_on_right(side: str) -> int:
    """Return which of the first two CAVs has the other one on its right: a van at its kerb hides them from each
    other."""
    return 1 if side == "perpendicular_right_of" else 2


def _draft_runs_sign(rng: random.Random) -> Draft:
    """A CAV behind the van that runs the sign sees it; one on the main road does not."""
    passes = rng.random() < 0.6
    turns = "straight" if passes else "left", rng.choice(("left", "right"))
    egos = [ego | {"entry_road": road} for ego, road in zip(_draft_egos(*turns), ("main", "side"), strict=True)]
    side = "perpendicular_right_of" if passes else "perpendicular_left_of"
    return {
        "topology": Topology.T_JUNCTION,
        "ego_vehicles": egos,
        "vehicle_constraints": [draft_relation(2, side, 1)],
        "actors": [_draft_car("in_intersection", "normal", vehicle=2) | {"actor_id": "van_2"}]
        + [_draft_van(1)] * passes,
    }


def _draft_lead_braking(rng: random.Random) -> Draft:
    """The first CAV of a queue hides the car ahead from the second one."""
    turn = rng.choice(("left", "right"))
    relations = [draft_relation(2, "same_lane_as", 1), draft_relation(2, "follow_route_of", 1)]
    return {
        "ego_vehicles": _draft_egos(turn, turn),
        "vehicle_constraints": relations,
        "actors": [_draft_car("on_approach", "erratic")],
    }


def _draft_lead_stopped(rng: random.Random) -> Draft:
    """The car stands half beside the lane, so that it can be passed."""
    stopped = _draft_car("after_turn", "stopped") | {"motion": "static", "lateral_position": "half_right"}
    return _draft_turn_and_witness(rng) | {"actors": [stopped]}


def _draft_pulls_out(rng: random.Random) -> Draft:
    leaving = _draft_car("after_turn", "slow") | {"lateral_position": "offroad_right"}
    return _draft_turn_and_witness(rng) | {"actors": [leaving, _draft_van(1, "after_turn")]}


TYPOLOGIES: Mapping[int, PreCrashTypology] = {
    5: PreCrashTypology(
        "running a stop sign", "a van leaves the minor road without stopping", _draft_runs_sign, ("minor_road",)
    ),
    11: PreCrashTypology(
        "pedestrian, vehicle manoeuvring", "a CAV that turns and a walker", _make_crossing_draft("walker", True), HOUSES
    ),
    12: PreCrashTypology(
        "pedestrian, vehicle going on", "a CAV and a walker", _make_crossing_draft("walker", False), BENDS
    ),
    13: PreCrashTypology(
        "cyclist, vehicle manoeuvring", "a CAV that turns and a cyclist", _make_crossing_draft("cyclist", True), HOUSES
    ),
    14: PreCrashTypology(
        "cyclist, vehicle going on", "a CAV and a cyclist", _make_crossing_draft("cyclist", False), BENDS
    ),
    17: PreCrashTypology(
        "vehicle parking, same direction", "a CAV and a car that leaves its parking place", _draft_pulls_out, HOUSES
    ),
    25: PreCrashTypology(
        "lead vehicle decelerating",
        "CAVs in a queue and a car that brakes hard",
        _draft_lead_braking,
        STRAIGHT,
    ),
    26: PreCrashTypology(
        "lead vehicle stopped", "a CAV and a car that stands behind the corner", _draft_lead_stopped, STRAIGHT
    ),
    27: PreCrashTypology(
        "left turn across path, opposite directions, signals",
        "a CAV that turns left and an oncoming one",
        _draft_left_across_signals,
        ("boulevard", "main_street"),
    ),
    28: PreCrashTypology(
        "right turn at signals",
        "a CAV that turns right and one in the same exit",
        _draft_right_turn,
        ("main_street",),
    ),
    29: PreCrashTypology(
        "left turn across path, opposite directions, no signals",
        "a CAV that turns left and an oncoming one",
        _draft_left_across,
        ("old_town", "old_town", "quiet_crossing", "school_crossing"),
    ),
    30: PreCrashTypology(
        "straight crossing paths, no signals",
        "CAVs from two roads, both straight on",
        _draft_straight_paths,
        ("town_crossing", "school_crossing"),
    ),
    31: PreCrashTypology("turning, no signals", "a CAV that turns and one on the other road", _draft_turning, HOUSES),
}
