"""Family `platoon-crossing`: platoons of CAVs reach the crossing of two dual carriageways at the same time."""

from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_parts import (
    FamilyTraffic,
    build_scenario,
    find_lane_start,
    load_network,
    read_values,
)
from mdrive_sumo.generate.hard.road_traffic import CARS, Platoon, TrafficFlow, build_flows, build_platoons
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario import Scenario

NETWORK = "hard_dual_crossing"
GOAL_M = 40.0
"""[m] Distance of the goals behind the crossing."""
PARAMETERS = (
    FamilyParameter("eastward", 1.0, 4.0, "", "number of CAVs in the eastward platoon, rounded"),
    FamilyParameter("northward", 1.0, 4.0, "", "number of CAVs in the northward platoon, rounded"),
    FamilyParameter("westward", 0.0, 2.0, "", "number of CAVs in the westward platoon, rounded"),
    FamilyParameter("arrival", 4.0, 6.0, "s", "time after which the eastward platoon is due at the crossing"),
    FamilyParameter("north_offset", -2.0, 2.0, "s", "how much later the northward platoon is due"),
    FamilyParameter("west_offset", -3.0, 3.0, "s", "how much later the westward platoon is due"),
    FamilyParameter("east_speed", 14.0, 22.0, "m/s", "speed of the eastward and westward platoons"),
    FamilyParameter("north_speed", 12.0, 19.0, "m/s", "speed of the northward platoon"),
    FamilyParameter("headway", 0.5, 1.6, "s", "time headway in platoons"),
    FamilyParameter("lanes", 0.0, 3.0, "", "which lanes: 1 is added for the left one eastward, 2 northward, rounded"),
    FamilyParameter("flow", 0.0, 900.0, "veh/h", "other traffic on each lane of the priority road without a platoon"),
)


def compute_lead(roads: RoadMap, lanes: tuple[str, ...], speed: float, due_s: float) -> float:
    """Return the station [m] from which a vehicle reaches the junction of a chain of lanes after `due_s` [s]."""
    inside = next(lane for lane in lanes if roads.lanes[lane].junction)
    return find_lane_start(roads, lanes, inside) - speed * due_s


def _build(candidate: FamilyCandidate) -> Scenario:
    values, roads = read_values(FAMILY, candidate), load_network(NETWORK)
    lanes = round(values["lanes"])
    east_lane, north_lane = lanes % 2, lanes // 2
    ways = (
        ("west_in", "east_out", east_lane, "eastward", values["east_speed"], 0.0),
        ("south_in", "north_out", north_lane, "northward", values["north_speed"], values["north_offset"]),
        ("east_in", "west_out", east_lane, "westward", values["east_speed"], values["west_offset"]),
    )
    platoons: list[Platoon] = []
    for entry, leave, lane, name, speed, offset in ways:
        chain = find_lane_path(roads, f"{entry}_{lane}", f"{leave}_{lane}")
        lead_m = compute_lead(roads, chain, speed, values["arrival"] + offset)
        goal_m = find_lane_start(roads, chain, chain[-1]) + GOAL_M
        platoons.append(Platoon(chain, round(values[name]), lead_m, goal_m, speed, values["headway"]))
    egos = build_platoons(roads, platoons)
    other = 1 - east_lane
    flows = [
        TrafficFlow(find_lane_path(roads, f"{entry}_{other}", f"{leave}_{other}"), values["flow"], CARS)
        for entry, leave in (("west_in", "east_out"), ("east_in", "west_out"))
    ]
    vehicles = build_flows(roads, flows, candidate.seed, egos)
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic(vehicles))


FAMILY = ScenarioFamily(
    category="platoon-crossing",
    description="Platoons of CAVs cross each other's way at 12 to 22 m/s; halls at the corners hide them.",
    parameters=PARAMETERS,
    build=_build,
)
