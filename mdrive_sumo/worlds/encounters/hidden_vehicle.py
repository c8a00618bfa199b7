"""Encounter of a CAV with a hidden vehicle where their lanes meet, and a witness behind the hidden vehicle."""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import build_driving_actor, build_mast
from mdrive_sumo.worlds.placement.cavs import build_cav, build_platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_chain_length, compute_pose, find_conflict

BEYOND_M = 60.0
"""[m] Distance from a conflict to the goals."""
RIM_M = 3.0
"""[m] Least distance of starts and goals from the ends of a chain."""
MAST_M = 0.5
"""[m] A roadside unit hangs this far from the conflict, above the junction."""
FOLLOWER_GAP_M = 20.0
"""[m] Between the centres of CAVs that follow."""


@dataclass(frozen=True, slots=True)
class Encounter:
    """Chains of lanes of an encounter."""

    own: Lanes
    hidden: Lanes
    witness: Lanes
    """The hidden vehicle's chain, or one beside it that begins on the same edge."""
    mean_speed: float
    """[m/s] Mean speed of CAV 0 until the conflict, by which the hidden vehicle is timed."""
    follower_speed: float
    """[m/s] Of the CAVs that follow the witness."""


@dataclass(frozen=True, slots=True)
class PlacedEncounter:
    """CAV 0, the hidden vehicle (a CAV or an actor), the witness, which is CAV 1, or a mast instead, and followers."""

    egos: tuple[Ego, ...]
    actors: tuple[Actor, ...]
    rsus: tuple[RoadsideUnit, ...]


def place_encounter(roads: RoadMap, encounter: Encounter, values: Mapping[str, float]) -> PlacedEncounter:
    """Return the road users of an encounter.

    values: `own_m` [m] of CAV 0 before the conflict, `own_speed` and `hidden_speed` [m/s], `gap_s` by which the hidden
    vehicle is later, `behind_m` [m] of the witness behind it, `cavs`; from 0.5 on, `connected`: the hidden vehicle is a
    CAV, and `mast` (may be missing): a roadside unit sees it, no witness. Distances that the chains cannot hold are
    shortened. Raises NoRoomError if there is no room at all.
    """
    at_own, at_hidden = find_conflict(roads, encounter.own, encounter.hidden)
    own_m = max(at_own - values["own_m"], RIM_M)
    needed_s = (at_own - own_m) / encounter.mean_speed + values["gap_s"]
    speed = min(values["hidden_speed"], roads.lanes[encounter.hidden[0]].speed_limit)
    hidden_m = max(at_hidden - speed * max(needed_s, 1.0), RIM_M + values["behind_m"])
    witness_m = hidden_m - values["behind_m"]
    own_goal, hidden_goal, witness_goal = (
        min(at + BEYOND_M, compute_chain_length(roads, chain) - RIM_M)
        for at, chain in ((at_own, encounter.own), (at_hidden, encounter.hidden), (at_hidden, encounter.witness))
    )
    egos = [build_cav(roads, "0", encounter.own, (own_m, own_goal), values["own_speed"])]
    actors: list[Actor] = []
    if values["connected"] >= 0.5:
        egos.append(build_cav(roads, "hidden", encounter.hidden, (hidden_m, hidden_goal), speed))
    else:
        actors.append(build_driving_actor(roads, "hidden", "car", (encounter.hidden, hidden_m, speed)))
    has_witness = values.get("mast", 0.0) < 0.5
    if has_witness:
        egos.append(build_cav(roads, "1", encounter.witness, (witness_m, witness_goal), speed))
    # By turns behind CAV 0 and the witness; without one all behind CAV 0: a CAV in no danger makes it easier for all.
    names = [str(i + 2) for i in range(round(values["cavs"]) - len(egos))]
    lines = ((encounter.own, own_m, own_goal, values["own_speed"], names[:: 2 if has_witness else 1]),)
    if has_witness:
        lines += ((encounter.witness, witness_m, witness_goal, encounter.follower_speed, names[1::2]),)
    for lanes, front, goal, line_speed, line in lines:
        egos += build_platoon(roads, line, lanes, (front - FOLLOWER_GAP_M, FOLLOWER_GAP_M), (goal, line_speed))
    rsus = () if has_witness else (build_mast("rsu", compute_pose(roads, encounter.own, at_own, MAST_M)),)
    return PlacedEncounter(tuple(egos), tuple(actors), rsus)
