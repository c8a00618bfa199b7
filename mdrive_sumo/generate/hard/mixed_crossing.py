"""Family `mixed-crossing`: CAVs cross a priority road; its fast traffic is not connected, apart from single CAVs."""

from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_parts import (
    FamilyTraffic,
    build_scenario,
    find_lane_start,
    load_network,
    read_values,
)
from mdrive_sumo.generate.hard.platoon_crossing import compute_lead
from mdrive_sumo.generate.hard.road_traffic import CARS, MIXED, Platoon, TrafficFlow, build_flows, build_platoons
from mdrive_sumo.roads import find_lane_path
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario

NETWORK = "hard_one_way_crossing"
GOAL_M = 40.0
"""[m] Distance of the goals behind the crossing."""
RSU = RoadsideUnit(id="rsu", x=-4.6, y=-9.4)
"""On the pavement of the south-west corner: it sees along both roads."""
PARAMETERS = (
    FamilyParameter("northward", 1.0, 4.0, "", "number of CAVs that cross northward, rounded"),
    FamilyParameter("eastward", 1.0, 2.0, "", "number of CAVs in the eastward traffic, rounded"),
    FamilyParameter("westward", 0.0, 2.0, "", "number of CAVs in the westward traffic, rounded"),
    FamilyParameter("rsu", 0.0, 1.0, "", "whether there is a road-side unit, rounded"),
    FamilyParameter("arrival", 4.0, 7.0, "s", "time after which the first northward CAV is due at the crossing"),
    FamilyParameter("main_offset", -1.5, 3.0, "s", "how much later the CAVs on the priority road are due"),
    FamilyParameter("speed", 16.0, 19.4, "m/s", "start speed of the CAVs that cross"),
    FamilyParameter("main_speed", 16.0, 21.0, "m/s", "start speed of the CAVs on the priority road"),
    FamilyParameter("headway", 0.8, 2.0, "s", "time headway of CAVs"),
    FamilyParameter("near_flow", 50.0, 600.0, "veh/h", "eastward traffic on each lane that is not connected"),
    FamilyParameter("far_flow", 50.0, 600.0, "veh/h", "westward traffic on each lane that is not connected"),
)


def _build(candidate: FamilyCandidate) -> Scenario:
    values, roads = read_values(FAMILY, candidate), load_network(NETWORK)
    ways = (
        ("south_in", "north_out", 1, "northward", values["speed"], 0.0),
        ("west_in", "east_out", 0, "eastward", values["main_speed"], values["main_offset"]),
        ("east_in", "west_out", 1, "westward", values["main_speed"], values["main_offset"]),
    )
    platoons: list[Platoon] = []
    for entry, leave, lane, name, speed, offset in ways:
        chain = find_lane_path(roads, f"{entry}_{lane}", f"{leave}_{lane}")
        lead_m = compute_lead(roads, chain, speed, values["arrival"] + offset)
        goal_m = find_lane_start(roads, chain, chain[-1]) + GOAL_M
        platoons.append(Platoon(chain, round(values[name]), lead_m, goal_m, speed, values["headway"]))
    egos = build_platoons(roads, platoons)
    flows = [
        TrafficFlow(find_lane_path(roads, f"{entry}_{k}", f"{leave}_{k}"), values[name], CARS if k else MIXED)
        for entry, leave, name in (("west_in", "east_out", "near_flow"), ("east_in", "west_out", "far_flow"))
        for k in (0, 1)
    ]
    vehicles = build_flows(roads, flows, candidate.seed, egos)
    rsus = (RSU,) if round(values["rsu"]) else ()
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic(vehicles, (), rsus))


FAMILY = ScenarioFamily(
    category="mixed-crossing",
    description="CAVs cross a priority road with traffic at 20 m/s that sends nothing, but for single CAVs in it.",
    parameters=PARAMETERS,
    build=_build,
)
