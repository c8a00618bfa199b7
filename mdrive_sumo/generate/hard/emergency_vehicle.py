"""Family `emergency-vehicle`: an ambulance crosses a priority road without stopping; the corners hide it."""

from mdrive_sumo.generate.hard.crossing_roads import (
    SITE_PARAMETER,
    CrossingFlow,
    CrossingPlatoon,
    build_crossing_traffic,
    compute_lead,
    find_site,
)
from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_scenario import FamilyTraffic, build_scenario, load_network, read_values
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.worlds.placement.bodies import build_driving_actor
from mdrive_sumo.worlds.placement.cavs import build_platoons
from mdrive_sumo.worlds.streams.lane_flows import CARS

PARAMETERS = (
    FamilyParameter("eastward", 1.0, 5.0, "", "number of CAVs that drive east, rounded"),
    FamilyParameter("westward", 1.0, 5.0, "", "number of CAVs that drive west, rounded"),
    FamilyParameter("witnesses", 0.0, 1.0, "", "number of CAVs that see the ambulance, rounded"),
    FamilyParameter("rsu", 0.0, 1.0, "", "whether there is a road-side unit (from 0.5 on, or without witnesses)"),
    FamilyParameter("arrival", 5.0, 8.0, "s", "time after which the ambulance is due at the crossing"),
    FamilyParameter("ambulance_speed", 17.0, 25.0, "m/s", "speed of the ambulance"),
    FamilyParameter("east_offset", -1.5, 1.5, "s", "how much later the first eastward CAV is due"),
    FamilyParameter("west_offset", -1.5, 1.5, "s", "how much later the first westward CAV is due"),
    FamilyParameter("witness_offset", 1.5, 3.5, "s", "how much later the first witness is due"),
    FamilyParameter("speed", 16.0, 22.0, "m/s", "start speed of the CAVs on the priority road"),
    FamilyParameter("headway", 0.7, 1.5, "s", "time headway of CAVs"),
    FamilyParameter("flow", 0.0, 800.0, "veh/h", "other traffic that follows on three lanes of the priority road"),
)
WITNESS_SPEED = 11.0
"""[m/s] Start speed of the witnesses."""


def _build(family: ScenarioFamily, candidate: FamilyCandidate) -> Scenario:
    values = read_values(family, candidate)
    site = find_site(values)
    roads = load_network(site.network)
    ways = (
        ("eastward", "eastward", values["speed"], values["east_offset"]),
        ("westward", "westward", values["speed"], values["west_offset"]),
        ("witness", "witnesses", WITNESS_SPEED, values["witness_offset"]),
    )
    speed = values["ambulance_speed"] * site.speed_factor
    lane = site.find_chain(roads, "minor", 1)  # nearest to the corner: hidden longest
    start_m = compute_lead(roads, lane, speed, values["arrival"])
    arrival_s = (compute_lead(roads, lane, 0.0, 0.0) - start_m) / speed
    platoons = [
        CrossingPlatoon(direction, 1, values[name], fast, arrival_s + offset, values["headway"])
        for direction, name, fast, offset in ways
    ]
    egos = build_platoons(roads, [platoon.place(roads, site) for platoon in platoons])
    ambulance = build_driving_actor(roads, "ambulance", "ambulance", (lane, start_m, speed), avoid_collision=False)
    flows = [
        CrossingFlow(direction, k, values["flow"], CARS, is_entering=True)
        for direction, k in (("eastward", 0), ("eastward", 1), ("westward", 1))
    ]
    vehicles = build_crossing_traffic(roads, site, flows, candidate.seed, egos)
    rsus = (site.rsu,) if values["rsu"] >= 0.5 or not round(values["witnesses"]) else ()
    traffic = FamilyTraffic(vehicles, (ambulance,), rsus, signals=site.corridor is not None)
    return build_scenario(family, candidate, roads, egos, traffic)


def _build_on_road(candidate: FamilyCandidate) -> Scenario:
    return _build(FAMILY, candidate)


def _build_in_corridor(candidate: FamilyCandidate) -> Scenario:
    return _build(CORRIDOR_FAMILY, candidate)


FAMILY = ScenarioFamily(
    category="emergency-vehicle",
    description="An ambulance on call crosses a priority road at 12 to 25 m/s and comes into view at the last moment.",
    parameters=PARAMETERS,
    build=_build_on_road,
)
CORRIDOR_FAMILY = ScenarioFamily(
    category="corridor-emergency-vehicle",
    description="An ambulance on call crosses a dense corridor and comes into view at the last moment.",
    parameters=(SITE_PARAMETER, *PARAMETERS),
    build=_build_in_corridor,
)
