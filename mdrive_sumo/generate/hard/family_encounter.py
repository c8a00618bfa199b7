"""Encounter of a CAV with a hidden vehicle where their lanes meet, and a witness behind the hidden vehicle."""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.generate.hard.family import FamilyParameter
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import build_driving_actor
from mdrive_sumo.worlds.placement.cavs import build_cav, build_platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_chain_length, compute_pose, find_conflict

BEYOND_M = 60.0
"""[m] Distance from a conflict to the goals."""
RIM_M = 3.0
"""[m] Least distance of starts and goals from the ends of a chain."""
MAST_M = 0.5
"""[m] A roadside unit hangs this far from the conflict, above the junction."""


def build_encounter_parameters(
    own_m: tuple[float, float], own_speed: tuple[float, float], hidden_speed: tuple[float, float]
) -> tuple[FamilyParameter, ...]:
    """Return the parameters that all encounters share, with the given bounds of distance and speeds."""
    return (
        FamilyParameter("own_m", *own_m, "m", "distance of CAV 0 from the conflict"),
        FamilyParameter("own_speed", *own_speed, "m/s", "start speed of CAV 0"),
        FamilyParameter("gap_s", -2.0, 2.0, "s", "how much later than CAV 0 the hidden vehicle reaches the conflict"),
        FamilyParameter("hidden_speed", *hidden_speed, "m/s", "speed of the hidden vehicle"),
        FamilyParameter("connected", 0.0, 1.0, "", "whether the hidden vehicle is a CAV (from 0.5 on)"),
        FamilyParameter("behind_m", 12.0, 30.0, "m", "distance of the witness behind the hidden vehicle"),
    )


@dataclass(frozen=True, slots=True)
class Encounter:
    """Chains of lanes of an encounter."""

    own: Lanes
    hidden: Lanes
    witness: Lanes
    """The hidden vehicle's chain, or one beside it that begins on the same edge."""
    mean_speed: float
    """[m/s] Mean speed of CAV 0 until the conflict, by which the hidden vehicle is timed."""


@dataclass(frozen=True, slots=True)
class PlacedEncounter:
    """CAV 0, the hidden vehicle (a CAV or an actor) and the witness, which is CAV 1; none where a mast sees."""

    egos: tuple[Ego, ...]
    actors: tuple[Actor, ...]
    own_m: tuple[float, float]
    """Stations [m] of start and goal of CAV 0 on its chain."""
    witness_m: tuple[float, float]
    """Those of the witness."""
    has_witness: bool = True


def place_encounter(roads: RoadMap, encounter: Encounter, values: Mapping[str, float]) -> PlacedEncounter:
    """Return the road users of an encounter, with `values` of `build_encounter_parameters`.

    Distances that the chains cannot hold are shortened. Raises NoRoomError if there is no room at all.
    """
    at_own, at_hidden = find_conflict(roads, encounter.own, encounter.hidden)
    own_m = max(at_own - values["own_m"], RIM_M)
    needed_s = (at_own - own_m) / encounter.mean_speed + values["gap_s"]
    speed = min(values["hidden_speed"], roads.lanes[encounter.hidden[0]].speed_limit)
    hidden_m = max(at_hidden - speed * max(needed_s, 1.0), RIM_M + values["behind_m"])
    witness_m = hidden_m - values["behind_m"]
    goals = [
        min(at + BEYOND_M, compute_chain_length(roads, chain) - RIM_M)
        for at, chain in ((at_own, encounter.own), (at_hidden, encounter.hidden), (at_hidden, encounter.witness))
    ]
    own = build_cav(roads, "0", encounter.own, (own_m, goals[0]), values["own_speed"])
    witness = build_cav(roads, "1", encounter.witness, (witness_m, goals[2]), speed)
    has_witness = values.get("mast", 0.0) < 0.5
    drives, seen = ((own_m, goals[0]), (witness_m, goals[2]), has_witness), (witness,) if has_witness else ()
    if values["connected"] >= 0.5:
        hidden = build_cav(roads, "hidden", encounter.hidden, (hidden_m, goals[1]), speed)
        return PlacedEncounter((own, hidden, *seen), (), *drives)
    actor = build_driving_actor(roads, "hidden", "car", (encounter.hidden, hidden_m, speed))
    return PlacedEncounter((own, *seen), (actor,), *drives)


def build_followers(
    roads: RoadMap, encounter: Encounter, placed: PlacedEncounter, count: int, speeds: tuple[float, float]
) -> list[Ego]:
    """Return up to `count` more CAVs, by turns behind CAV 0 and behind the witness; `speeds` [m/s] of each line.

    Without a witness all are behind CAV 0: a CAV that is in no danger makes the situation easier for every agent.
    """
    names, gap = [str(i + 2) for i in range(count)], 20.0
    step = 2 if placed.has_witness else 1
    behind = names[1::2] if placed.has_witness else []
    lines = ((encounter.own, placed.own_m, names[::step]), (encounter.witness, placed.witness_m, behind))
    made: list[Ego] = []
    for (lanes, (front, goal), line), speed in zip(lines, speeds, strict=True):
        made += build_platoon(roads, line, lanes, (front - gap, gap), (goal, speed))
    return made


def build_mast(roads: RoadMap, encounter: Encounter, name: str = "rsu") -> RoadsideUnit:
    """Return a roadside unit on a mast arm above the conflict."""
    pose = compute_pose(roads, encounter.own, find_conflict(roads, encounter.own, encounter.hidden)[0], MAST_M)
    return RoadsideUnit(id=name, x=pose.x, y=pose.y)
