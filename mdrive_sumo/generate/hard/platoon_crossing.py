"""Family `platoon-crossing`: platoons of CAVs meet where a one-way street crosses a dual carriageway."""

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

NETWORK = "hard_one_way_crossing"
GOAL_M = 40.0
"""[m] Distance of the goals behind the crossing."""
PARAMETERS = (
    FamilyParameter("eastward", 1.0, 4.0, "", "number of CAVs in the eastward platoon, rounded"),
    FamilyParameter("northward", 1.0, 4.0, "", "number of CAVs in the northward platoon, rounded"),
    FamilyParameter("westward", 0.0, 2.0, "", "number of CAVs in the westward platoon, rounded"),
    FamilyParameter("arrival", 4.0, 6.0, "s", "time after which the eastward platoon is due at the crossing"),
    FamilyParameter("north_offset", -2.0, 2.0, "s", "how much later the northward platoon is due"),
    FamilyParameter("west_offset", -3.0, 3.0, "s", "how much later the westward platoon is due"),
    FamilyParameter("east_speed", 16.0, 22.0, "m/s", "speed of the eastward and westward platoons"),
    FamilyParameter("north_speed", 14.0, 19.0, "m/s", "speed of the northward platoon"),
    FamilyParameter("headway", 0.5, 1.6, "s", "time headway in platoons"),
    FamilyParameter("flow", 0.0, 900.0, "veh/h", "other traffic on each left lane of the priority road"),
)


def compute_lead(roads: RoadMap, lanes: tuple[str, ...], speed: float, due_s: float) -> float:
    """Return the station [m] from which a vehicle reaches the junction of a chain of lanes after `due_s` [s]."""
    inside = next(lane for lane in lanes if roads.lanes[lane].junction)
    return find_lane_start(roads, lanes, inside) - speed * due_s


def _build(candidate: FamilyCandidate) -> Scenario:
    values, roads = read_values(FAMILY, candidate), load_network(NETWORK)
    ways = (
        ("west_in", "east_out", 0, "eastward", values["east_speed"], 0.0),
        ("south_in", "north_out", 1, "northward", values["north_speed"], values["north_offset"]),
        ("east_in", "west_out", 0, "westward", values["east_speed"], values["west_offset"]),
    )
    platoons: list[Platoon] = []
    for entry, leave, lane, name, speed, offset in ways:
        chain = find_lane_path(roads, f"{entry}_{lane}", f"{leave}_{lane}")
        lead_m = compute_lead(roads, chain, speed, values["arrival"] + offset)
        goal_m = find_lane_start(roads, chain, chain[-1]) + GOAL_M
        platoons.append(Platoon(chain, round(values[name]), lead_m, goal_m, speed, values["headway"]))
    egos = build_platoons(roads, platoons)
    flows = [
        TrafficFlow(find_lane_path(roads, f"{entry}_1", f"{leave}_1"), values["flow"], CARS)
        for entry, leave in (("west_in", "east_out"), ("east_in", "west_out"))
    ]
    vehicles = build_flows(roads, flows, candidate.seed, egos)
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic(vehicles))


FAMILY = ScenarioFamily(
    category="platoon-crossing",
    description="Platoons of CAVs cross each other's way at 14 to 22 m/s; halls at the corners hide them.",
    parameters=PARAMETERS,
    build=_build,
)
