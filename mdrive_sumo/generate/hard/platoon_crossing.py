"""Family `platoon-crossing`: platoons of CAVs meet where a one-way or side street crosses a priority road."""

from mdrive_sumo.generate.hard.crossing_roads import (
    SITE_PARAMETER,
    CrossingFlow,
    CrossingPlatoon,
    build_crossing_traffic,
    find_site,
)
from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_scenario import FamilyTraffic, build_scenario, load_network, read_values
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.worlds.placement.cavs import build_platoons
from mdrive_sumo.worlds.streams.lane_flows import CARS

PARAMETERS = (
    FamilyParameter("eastward", 1.0, 5.0, "", "number of CAVs in the eastward platoon, rounded"),
    FamilyParameter("northward", 1.0, 5.0, "", "number of CAVs in the platoon on the minor road, rounded"),
    FamilyParameter("westward", 0.0, 5.0, "", "number of CAVs in the westward platoon, rounded"),
    FamilyParameter("arrival", 4.0, 6.0, "s", "time after which the eastward platoon is due at the crossing"),
    FamilyParameter("north_offset", -2.0, 2.0, "s", "how much later the platoon on the minor road is due"),
    FamilyParameter("west_offset", -3.0, 3.0, "s", "how much later the westward platoon is due"),
    FamilyParameter("east_speed", 16.0, 22.0, "m/s", "speed of the eastward and westward platoons"),
    FamilyParameter("north_speed", 14.0, 19.0, "m/s", "speed of the platoon on the minor road"),
    FamilyParameter("headway", 0.5, 1.6, "s", "time headway in platoons"),
    FamilyParameter("flow", 0.0, 900.0, "veh/h", "other traffic on each left lane of the priority road"),
)


def _build(family: ScenarioFamily, candidate: FamilyCandidate) -> Scenario:
    values = read_values(family, candidate)
    site = find_site(values)
    roads = load_network(site.network)
    ways = (
        ("eastward", 0, "eastward", values["east_speed"], 0.0),
        ("minor", 1, "northward", values["north_speed"], values["north_offset"]),
        ("westward", 0, "westward", values["east_speed"], values["west_offset"]),
    )
    platoons = [
        CrossingPlatoon(direction, lane, values[name], speed, values["arrival"] + offset, values["headway"])
        for direction, lane, name, speed, offset in ways
    ]
    egos = build_platoons(roads, [platoon.place(roads, site) for platoon in platoons])
    flows = [CrossingFlow(direction, 1, values["flow"], CARS) for direction in ("eastward", "westward")]
    vehicles = build_crossing_traffic(roads, site, flows, candidate.seed, egos)
    traffic = FamilyTraffic(vehicles, signals=site.corridor is not None)
    return build_scenario(family, candidate, roads, egos, traffic)


def _build_on_road(candidate: FamilyCandidate) -> Scenario:
    return _build(FAMILY, candidate)


def _build_in_corridor(candidate: FamilyCandidate) -> Scenario:
    return _build(CORRIDOR_FAMILY, candidate)


FAMILY = ScenarioFamily(
    category="platoon-crossing",
    description="Platoons of CAVs cross each other's way at 10 to 22 m/s; halls or houses at the corners hide them.",
    parameters=PARAMETERS,
    build=_build_on_road,
)
CORRIDOR_FAMILY = ScenarioFamily(
    category="corridor-platoon-crossing",
    description="Platoons of CAVs cross each other's way in a dense corridor; houses at the corners hide them.",
    parameters=(SITE_PARAMETER, *PARAMETERS),
    build=_build_in_corridor,
)
