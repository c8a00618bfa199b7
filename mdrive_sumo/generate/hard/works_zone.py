"""Family `works-zone`: both directions of a country road share one lane beside road works, between two bends."""

from collections.abc import Iterator

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    load_network,
    stage_flows,
)
from mdrive_sumo.roads import find_lane_path
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_actor, build_parked_vehicle
from mdrive_sumo.worlds.placement.cavs import Platoon
from mdrive_sumo.worlds.placement.lane_chains import find_lane_start
from mdrive_sumo.worlds.streams.lane_flows import CARS, TrafficFlow

NETWORK = "hard_works_road"
SITE_M = (-34.0, 34.0)
"""[m] Range of x of the closed part of the eastward lane."""
TRUCK_Y_M, BARRIER_Y_M = -2.5, -0.85
"""[m] y of trucks on the closed lane, and of the barriers along the open one."""
BARRIER_PITCH_M = 8.0
"""[m] Distance between two barriers."""
GOAL_M = 40.0
"""[m] Distance of the goals behind the works zone."""
PARAMETERS = (
    FamilyParameter("eastward", 1.0, 4.0, "", "number of CAVs that drive east, rounded"),
    FamilyParameter("westward", 1.0, 4.0, "", "number of CAVs that drive west, rounded"),
    FamilyParameter("arrival", 3.0, 6.0, "s", "time after which the first eastward CAV is due at the works zone"),
    FamilyParameter("offset", -2.5, 2.5, "s", "how much later the first westward CAV is due"),
    FamilyParameter("east_speed", 13.0, 20.0, "m/s", "start speed of eastward CAVs"),
    FamilyParameter("west_speed", 13.0, 20.0, "m/s", "start speed of westward CAVs"),
    FamilyParameter("east_headway", 0.8, 2.0, "s", "time headway of eastward CAVs"),
    FamilyParameter("west_headway", 0.8, 2.0, "s", "time headway of westward CAVs"),
    FamilyParameter("trucks", 1.0, 4.0, "", "number of trucks on the closed lane, rounded"),
    FamilyParameter("first_truck", 0.0, 1.0, "", "place of the first truck, from the west end of the site on"),
    FamilyParameter("flow", 0.0, 500.0, "veh/h", "other traffic that follows the eastward CAVs"),
)


def build_site(trucks: int, first: float) -> Iterator[Actor]:
    """Return the trucks on the closed lane and the barriers; `first`: place of the first truck as a share."""
    length = BODY_SIZES["truck"][0] + 1.5
    free = SITE_M[1] - SITE_M[0] - trucks * length
    for k in range(trucks):
        x = SITE_M[0] + first * free + (k + 0.5) * length
        yield build_parked_vehicle(f"truck{k}", "truck", Pose(x=round(x, 3), y=TRUCK_Y_M, yaw=0.0), mirrored=False)
    for k in range(int((SITE_M[1] - SITE_M[0]) / BARRIER_PITCH_M) + 1):
        pose = Pose(x=SITE_M[0] + k * BARRIER_PITCH_M, y=BARRIER_Y_M, yaw=0.0)
        yield build_actor(f"barrier{k}", BODIES["barrier"], pose, mirrored=False)


def _stage(values: Values, seed: str) -> FamilyScene:
    roads = load_network(NETWORK)
    east = find_lane_path(roads, "west_in_0", "east_out_0")
    west = find_lane_path(roads, "east_in_0", "west_out_0")
    dues = (values["arrival"], values["arrival"] + values["offset"])
    platoons = [
        Platoon(
            chain,
            round(values[f"{name}ward"]),
            find_lane_start(roads, chain, zone) - due * values[f"{name}_speed"],
            find_lane_start(roads, chain, chain[-1]) + GOAL_M,
            values[f"{name}_speed"],
            values[f"{name}_headway"],
        )
        for name, chain, zone, due in (
            ("east", east, "zone_eastward_0", dues[0]),
            ("west", west, "zone_westward_0", dues[1]),
        )
    ]
    flow = TrafficFlow(east, values["flow"], CARS, is_entering=True)
    return stage_flows(
        roads, platoons, (flow,), seed, tuple(build_site(round(values["trucks"]), values["first_truck"]))
    )


FAMILY = ScenarioFamily(
    category="works-zone",
    description="CAVs of both directions share one lane beside road works; bends between hedges hide who comes.",
    parameters=PARAMETERS,
    stage=_stage,
)
