"""Family `hidden-stop`: a truck leaves the lane just before vehicles that stand in it, in a bend of a motorway."""

from collections.abc import Iterator

import numpy as np

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    load_network,
    stage_flows,
)
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, StartMotion, TimeTrigger
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_driving_actor, build_rider
from mdrive_sumo.worlds.placement.cavs import Platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_chain_length, compute_pose
from mdrive_sumo.worlds.streams.lane_flows import CARS, MIXED, TrafficFlow

NETWORK = "hard_motorway_bend"
LANE_M = 3.5
"""[m] Width of a lane of `NETWORK`."""
SWERVE_M = 60.0
"""[m] Length of the truck's lane change: 2.4 s at 25 m/s."""
QUEUE_GAP_M = 3.0
"""[m] Between standing vehicles; SUMO's drivers keep 2.5 m."""
GOAL_M = 120.0
"""[m] Distance of the goals behind the place where the queue stood."""
PARAMETERS = (
    FamilyParameter("behind", 1.0, 3.0, "", "number of CAVs that follow the truck, rounded"),
    FamilyParameter("ahead", 1.0, 2.0, "", "number of CAVs on the next lane that pass the queue first, rounded"),
    FamilyParameter("queue", 1.0, 4.0, "", "number of standing vehicles, rounded"),
    FamilyParameter("queue_at", 290.0, 390.0, "m", "place of the last standing vehicle along the road"),
    FamilyParameter("speed", 20.0, 27.0, "m/s", "start speed of CAVs and truck"),
    FamilyParameter("truck_gap", 0.6, 1.3, "s", "time headway between truck and first CAV"),
    FamilyParameter("headway", 0.6, 1.3, "s", "time headway of CAVs"),
    FamilyParameter("truck_time", 4.0, 7.0, "s", "time after which the truck begins to leave the lane"),
    FamilyParameter("swerve_at", 42.0, 70.0, "m", "distance to the queue at which the truck begins to leave the lane"),
    FamilyParameter("standing", 9.0, 16.0, "s", "time after which the queue moves again"),
    FamilyParameter("truck_side", 0.0, 1.0, "", "side to which the truck leaves, rounded: 0 right, 1 left"),
    FamilyParameter("right_flow", 0.0, 900.0, "veh/h", "traffic on the right lane"),
    FamilyParameter("left_flow", 0.0, 900.0, "veh/h", "traffic on the left lane"),
)


def build_swerving_truck(
    roads: RoadMap, lanes: Lanes, start_m: float, swerve: tuple[float, float], speed: float
) -> Actor:
    """Return a truck along a chain of lanes that moves over by `swerve[1]` [m] to the left from station `swerve[0]` on.

    It drives on beyond the end of the road.
    """
    begin, shift = swerve
    end = compute_chain_length(roads, lanes)
    poses: list[Pose] = []
    for station in np.append(np.arange(start_m, end, 2.0), end).tolist():
        share = min(max((station - begin) / SWERVE_M, 0.0), 1.0)
        poses.append(compute_pose(roads, lanes, station, shift * share * share * (3.0 - 2.0 * share)))
    return build_rider("truck", BODIES["truck"], poses, speed)


def _build_queue(roads: RoadMap, lanes: Lanes, values: Values) -> Iterator[Actor]:
    """Return the vehicles that stand in the lane until they start to drive."""
    station = values["queue_at"]
    trigger = TimeTrigger(at_s=values["standing"])
    for k in range(round(values["queue"])):
        model = "van" if k % 3 == 1 else "car"
        drive = (lanes, station, 18.0)
        yield build_driving_actor(roads, f"queue{k}", model, drive, trigger=trigger, action=StartMotion())
        station += BODY_SIZES[model][0] / 2 + QUEUE_GAP_M + BODY_SIZES["van" if k % 3 == 0 else "car"][0] / 2


def _stage(values: Values, seed: str) -> FamilyScene:
    roads = load_network(NETWORK)
    right, middle, left = (find_lane_path(roads, f"before_{i}", f"after_{i}") for i in (0, 1, 2))
    side = round(values["truck_side"])
    beside = right if side else left
    speed, queue_m = values["speed"], values["queue_at"]
    begin_m = queue_m - values["swerve_at"]
    truck_m = begin_m - speed * values["truck_time"]
    first_m = truck_m - BODY_SIZES["truck"][0] / 2 - values["truck_gap"] * speed - CAR.length / 2
    goal_m = min(queue_m + GOAL_M, compute_chain_length(roads, middle) - 20.0)
    ahead_m = first_m + 40.0 + round(values["ahead"]) * (CAR.length + values["headway"] * speed)
    platoons = (
        Platoon(middle, round(values["behind"]), first_m, goal_m, speed, values["headway"]),
        Platoon(beside, round(values["ahead"]), ahead_m, goal_m, speed, values["headway"]),
    )
    truck = build_swerving_truck(roads, middle, truck_m, (begin_m, LANE_M if side else -LANE_M), speed)
    actors = (truck, *_build_queue(roads, middle, values))
    flows = (TrafficFlow(right, values["right_flow"], MIXED), TrafficFlow(left, values["left_flow"], CARS))
    return stage_flows(roads, platoons, flows, seed, actors)


FAMILY = ScenarioFamily(
    category="hidden-stop",
    description="Behind a truck that leaves the lane at the last moment, vehicles stand in the bend of a motorway.",
    parameters=PARAMETERS,
    stage=_stage,
)
