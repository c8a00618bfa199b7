"""Family `narrow-street`: CAVs meet in a village street where parked vehicles leave one lane at two places."""

from collections.abc import Sequence

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    load_network,
    stage_flows,
)
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.cavs import Platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes
from mdrive_sumo.worlds.placement.parked_vehicles import ParkedRow, build_parked_row
from mdrive_sumo.worlds.streams.lane_flows import CARS, TrafficFlow

NETWORK = "hard_narrow_village"
NARROW_M = (186.0, 237.0)
"""[m] Stations of the first narrow place, the same from either end; the lane there belongs to the oncoming side."""
PARKED_OFFSET_M = 3.75
"""[m] From the centre of the lane that is narrowed to the middle of the parked vehicles: partly on the pavement."""
GOAL_M = 400.0
"""[m] Station of the goals: 45 m behind the second narrow place."""
PARAMETERS = (
    FamilyParameter("eastward", 1.0, 2.0, "", "number of CAVs that drive east, rounded"),
    FamilyParameter("westward", 1.0, 2.0, "", "number of CAVs that drive west, rounded"),
    FamilyParameter("arrival", 1.5, 5.0, "s", "time after which the first eastward CAV is due at a narrow place"),
    FamilyParameter("offset", -3.0, 3.0, "s", "how much later the first westward CAV is due at the other one"),
    FamilyParameter("speed", 7.0, 12.0, "m/s", "start speed"),
    FamilyParameter("east_headway", 0.8, 3.0, "s", "time headway of eastward CAVs"),
    FamilyParameter("west_headway", 0.8, 3.0, "s", "time headway of westward CAVs"),
    FamilyParameter("vans", 0.0, 1.0, "", "share of vans among the parked vehicles"),
    FamilyParameter("occupied", 0.5, 1.0, "", "share of the parking places that are taken"),
    FamilyParameter("flow", 0.0, 400.0, "veh/h", "other traffic that follows the eastward CAVs"),
)


def _build_parked_vehicles(
    roads: RoadMap, ways: Sequence[Lanes], vans: float, occupied: float, seed: str
) -> list[Actor]:
    """Return the parked vehicles at both narrow places, on the right of the direction that is narrowed."""
    rows: list[Actor] = []
    for name, way in zip(("south", "north"), ways, strict=True):
        row = ParkedRow(way, NARROW_M, -PARKED_OFFSET_M, vans, occupied)
        rows += build_parked_row(roads, row, seed, f"{name}_parked")
    return rows


def _stage(values: Values, seed: str) -> FamilyScene:
    roads = load_network(NETWORK)
    east = find_lane_path(roads, "west_eastward_0", "east_eastward_0")
    west = find_lane_path(roads, "east_westward_0", "west_westward_0")
    narrow_m, speed = NARROW_M[0], values["speed"]
    leads = [narrow_m - speed * values["arrival"], narrow_m - speed * (values["arrival"] + values["offset"])]
    lead_east, lead_west = (max(lead, 10.0) for lead in leads)
    platoons = (
        Platoon(east, round(values["eastward"]), lead_east, GOAL_M, speed, values["east_headway"]),
        Platoon(west, round(values["westward"]), lead_west, GOAL_M, speed, values["west_headway"]),
    )
    actors = _build_parked_vehicles(roads, (east, west), values["vans"], values["occupied"], seed)
    flow = TrafficFlow(east, values["flow"], CARS, is_entering=True)
    return stage_flows(roads, platoons, (flow,), seed, actors)


FAMILY = ScenarioFamily(
    category="narrow-street",
    description="CAVs meet in a village street with two single-lane places and room to wait between them.",
    parameters=PARAMETERS,
    stage=_stage,
)
