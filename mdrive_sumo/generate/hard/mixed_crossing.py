"""Family `mixed-crossing`: CAVs cross a priority road; its fast traffic is not connected, apart from single CAVs."""

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
from mdrive_sumo.worlds.streams.lane_flows import CARS, MIXED

PARAMETERS = (
    FamilyParameter("northward", 2.0, 8.0, "", "number of CAVs on the minor road, rounded"),
    FamilyParameter("eastward", 0.0, 1.0, "", "number of CAVs in the eastward traffic, rounded"),
    FamilyParameter("westward", 0.0, 1.0, "", "number of CAVs in the westward traffic, rounded"),
    FamilyParameter("rsu", 0.0, 1.0, "", "whether there is a road-side unit (from 0.5 on, or without CAVs there)"),
    FamilyParameter("arrival", 4.0, 7.0, "s", "time after which the first CAV on the minor road is due"),
    FamilyParameter("main_offset", -1.5, 3.0, "s", "how much later the CAVs on the priority road are due"),
    FamilyParameter("speed", 16.0, 19.4, "m/s", "start speed of the CAVs that cross"),
    FamilyParameter("main_speed", 16.0, 21.0, "m/s", "start speed of the CAVs on the priority road"),
    FamilyParameter("headway", 0.8, 2.0, "s", "time headway of CAVs"),
    FamilyParameter("near_flow", 50.0, 600.0, "veh/h", "eastward traffic on each lane that is not connected"),
    FamilyParameter("far_flow", 50.0, 600.0, "veh/h", "westward traffic on each lane that is not connected"),
)


def _build(family: ScenarioFamily, candidate: FamilyCandidate) -> Scenario:
    values = read_values(family, candidate)
    site = find_site(values)
    roads = load_network(site.network)
    ways = (
        ("minor", 1, "northward", values["speed"], 0.0),
        ("eastward", 0, "eastward", values["main_speed"], values["main_offset"]),
        ("westward", 1, "westward", values["main_speed"], values["main_offset"]),
    )
    platoons = [
        CrossingPlatoon(direction, lane, values[name], speed, values["arrival"] + offset, values["headway"])
        for direction, lane, name, speed, offset in ways
    ]
    egos = build_platoons(roads, [platoon.place(roads, site) for platoon in platoons])
    flows = [
        CrossingFlow(direction, k, values[name], CARS if k else MIXED)
        for direction, name in (("eastward", "near_flow"), ("westward", "far_flow"))
        for k in (0, 1)
    ]
    vehicles = build_crossing_traffic(roads, site, flows, candidate.seed, egos)
    has_witness = any(round(values[name]) for name in ("eastward", "westward"))
    rsus = (site.rsu,) if values["rsu"] >= 0.5 or not has_witness else ()
    traffic = FamilyTraffic(vehicles, (), rsus, signals=site.corridor is not None)
    return build_scenario(family, candidate, roads, egos, traffic)


def _build_on_road(candidate: FamilyCandidate) -> Scenario:
    return _build(FAMILY, candidate)


def _build_in_corridor(candidate: FamilyCandidate) -> Scenario:
    return _build(CORRIDOR_FAMILY, candidate)


FAMILY = ScenarioFamily(
    category="mixed-crossing",
    description="CAVs cross a priority road whose traffic of 14 to 20 m/s sends nothing, but for single CAVs in it.",
    parameters=PARAMETERS,
    build=_build_on_road,
)
CORRIDOR_FAMILY = ScenarioFamily(
    category="corridor-mixed-crossing",
    description="CAVs of a side street cross a dense corridor whose traffic sends nothing, but for single CAVs in it.",
    parameters=(SITE_PARAMETER, *PARAMETERS),
    build=_build_in_corridor,
)
