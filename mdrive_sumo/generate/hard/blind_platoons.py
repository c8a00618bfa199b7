"""Platoons of CAVs on two ways that cross in a junction, due there at about the same time."""

from itertools import permutations

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.placement.cavs import Platoon, build_platoons
from mdrive_sumo.worlds.placement.lane_chains import compute_chain_length, find_conflict
from mdrive_sumo.worlds.streams.lane_flows import CARS, TrafficFlow, build_flows

BEYOND_M = 40.0
"""[m] Distance from the crossing to the goals."""
RIM_M = 5.0
"""[m] Least distance of a CAV from the beginning of its lanes."""


def stage_blind_platoons(values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return the scene of a candidate."""
    sites = list(_find_crossings(roads))
    if not sites:
        raise ProposalRejected(PipelineStage.WAYS, f"network {roads.name}: expected ways that cross, found none")
    site = sites[min(int(values["site"] * len(sites)), len(sites) - 1)]
    platoons = []
    for (lanes, conflict_m), due_s, count in zip(
        site, (values["due_s"], values["due_s"] + values["gap_s"]), (values["own"], values["other"]), strict=True
    ):
        speed = 0.9 * roads.lanes[lanes[0]].speed_limit
        lead_m = max(conflict_m - speed * due_s, RIM_M)
        platoon = Platoon(lanes, 1, lead_m, conflict_m + BEYOND_M, speed, values["headway_s"])
        fitting = 1 + int((lead_m - RIM_M) / platoon.pitch_m)
        goal_m = min(conflict_m + BEYOND_M, compute_chain_length(roads, lanes) - RIM_M)
        platoons.append(Platoon(lanes, min(round(count), fitting), lead_m, goal_m, speed, values["headway_s"]))
    egos = build_platoons(roads, platoons)
    flows = [TrafficFlow(lanes, values["flow"], CARS, is_entering=True) for lanes, _ in site]
    return FamilyScene(egos, build_flows(roads, flows, seed, egos))


def _find_crossings(roads: RoadMap):
    """Yield pairs of ways that cross, with the station [m] of the crossing on each."""
    ways = [
        (lane.id, inside, roads.lanes[inside].successors[0])
        for lane in sorted(roads.driving, key=lambda one: one.id)
        if not lane.junction and not lane.lights
        for inside in lane.successors
        if roads.lanes[inside].junction and roads.lanes[inside].successors
    ]
    for one, other in permutations(ways, 2):
        if roads.lanes[one[0]].edge != roads.lanes[other[0]].edge and one[-1] != other[-1]:
            try:
                stations = find_conflict(roads, one, other)
            except InputError:
                continue
            yield tuple(zip((one, other), stations, strict=True))


FAMILY = ScenarioFamily(
    category="blind-platoons",
    description="Platoons of CAVs cross each other's way; houses at the corners hide them.",
    places=(
        PlaceChoice("crossing", {"arms": 4, "control": "priority", "keeps_sight": False}),
        PlaceChoice("crossing", {"arms": 4, "control": "right_before_left", "keeps_sight": False}),
    ),
    parameters=(
        FamilyParameter("site", 0.0, 1.0, "", "pair of ways"),
        FamilyParameter("due_s", 3.0, 6.0, "s", "time after which the first platoon is due"),
        FamilyParameter("gap_s", -1.5, 1.5, "s", "how much later the second platoon is due"),
        FamilyParameter("own", 1.0, 4.0, "", "CAVs of the first platoon"),
        FamilyParameter("other", 1.0, 4.0, "", "CAVs of the second platoon"),
        FamilyParameter("headway_s", 0.6, 1.6, "s", "headway in platoons"),
        FamilyParameter("flow", 0.0, 600.0, "veh/h", "other traffic that follows"),
    ),
    stage=stage_blind_platoons,
)
