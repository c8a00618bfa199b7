"""Family `emergency-vehicle`: an ambulance crosses a priority road without stopping; halls at the corners hide it."""

from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_parts import (
    FamilyTraffic,
    build_scenario,
    find_lane_start,
    load_network,
    read_values,
)
from mdrive_sumo.generate.hard.platoon_crossing import compute_lead
from mdrive_sumo.generate.hard.road_traffic import (
    CARS,
    Platoon,
    TrafficFlow,
    build_flows,
    build_moving_actor,
    build_platoons,
)
from mdrive_sumo.roads import find_lane_path
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario

NETWORK = "hard_one_way_crossing"
GOAL_M = 40.0
"""[m] Distance of the goals behind the crossing."""
RSU = RoadsideUnit(id="rsu", x=-4.6, y=-9.4)
"""On the pavement of the south-west corner: it sees along both roads."""
PARAMETERS = (
    FamilyParameter("eastward", 1.0, 3.0, "", "number of CAVs that drive east, rounded"),
    FamilyParameter("westward", 0.0, 3.0, "", "number of CAVs that drive west, rounded"),
    FamilyParameter("witnesses", 1.0, 2.0, "", "number of CAVs in the next lane that the ambulance overtakes, rounded"),
    FamilyParameter("rsu", 0.0, 1.0, "", "whether there is a road-side unit, rounded"),
    FamilyParameter("arrival", 5.0, 8.0, "s", "time after which the ambulance is due at the crossing"),
    FamilyParameter("ambulance_speed", 17.0, 25.0, "m/s", "speed of the ambulance"),
    FamilyParameter("east_offset", -1.5, 1.5, "s", "how much later the first eastward CAV is due"),
    FamilyParameter("west_offset", -1.5, 1.5, "s", "how much later the first westward CAV is due"),
    FamilyParameter("witness_offset", 1.5, 3.5, "s", "how much later the first northward CAV is due"),
    FamilyParameter("speed", 16.0, 22.0, "m/s", "start speed of the CAVs on the priority road"),
    FamilyParameter("headway", 0.7, 1.5, "s", "time headway of CAVs"),
    FamilyParameter("flow", 0.0, 800.0, "veh/h", "other traffic that follows on three lanes of the priority road"),
)
WITNESS_SPEED = 11.0
"""[m/s] Start speed of the northward CAVs."""


def _build(candidate: FamilyCandidate) -> Scenario:
    values, roads = read_values(FAMILY, candidate), load_network(NETWORK)
    arrival_s = values["arrival"]
    ways = (
        ("west_in", "east_out", 1, "eastward", values["speed"], values["east_offset"]),
        ("east_in", "west_out", 1, "westward", values["speed"], values["west_offset"]),
        ("south_in", "north_out", 0, "witnesses", WITNESS_SPEED, values["witness_offset"]),
    )
    platoons: list[Platoon] = []
    for entry, leave, lane, name, speed, offset in ways:
        chain = find_lane_path(roads, f"{entry}_{lane}", f"{leave}_{lane}")
        lead_m = compute_lead(roads, chain, speed, arrival_s + offset)
        goal_m = find_lane_start(roads, chain, chain[-1]) + GOAL_M
        platoons.append(Platoon(chain, round(values[name]), lead_m, goal_m, speed, values["headway"]))
    egos = build_platoons(roads, platoons)
    speed = values["ambulance_speed"]
    way = find_lane_path(roads, "south_in_1", "north_out_1")  # nearest to the corner: hidden longest
    start_m = compute_lead(roads, way, speed, arrival_s)
    ambulance = build_moving_actor("ambulance", "ambulance", roads, way, (start_m, speed), avoid_collision=False)
    flows = [
        TrafficFlow(find_lane_path(roads, f"{entry}_{k}", f"{leave}_{k}"), values["flow"], CARS, is_entering=True)
        for entry, leave, k in (("west_in", "east_out", 0), ("west_in", "east_out", 1), ("east_in", "west_out", 1))
    ]
    vehicles = build_flows(roads, flows, candidate.seed, egos)
    rsus = (RSU,) if round(values["rsu"]) else ()
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic(vehicles, (ambulance,), rsus))


FAMILY = ScenarioFamily(
    category="emergency-vehicle",
    description="An ambulance on call crosses a priority road at 17 to 25 m/s and comes into view at the last moment.",
    parameters=PARAMETERS,
    build=_build,
)
