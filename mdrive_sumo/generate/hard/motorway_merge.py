"""Family `motorway-merge`: CAVs come up a ramp behind an earth bank and merge into a motorway at speed."""

from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values, load_network
from mdrive_sumo.roads import find_lane_path
from mdrive_sumo.worlds.placement.cavs import Platoon, build_platoons
from mdrive_sumo.worlds.placement.lane_chains import RouteLaneChange, find_lane_start
from mdrive_sumo.worlds.streams.lane_flows import CARS, MIXED, TrafficFlow, build_flows

NETWORK = "hard_motorway_merge"
CHANGE_M = 80.0
"""[m] Length of a lane change: 3.5 m sideways at 30 m/s with a lateral acceleration of 3 m/s2."""
GOAL_M = 60.0
"""[m] Distance of the goals behind the end of the acceleration lane."""
PARAMETERS = (
    FamilyParameter("ramp_cavs", 1.0, 3.0, "", "number of CAVs on the ramp, rounded"),
    FamilyParameter("main_cavs", 1.0, 5.0, "", "number of CAVs on the motorway, rounded; every third one on the left"),
    FamilyParameter("ramp_distance", 80.0, 140.0, "m", "distance of the first ramp CAV from the nose"),
    FamilyParameter("ramp_speed", 17.0, 24.0, "m/s", "start speed on the ramp"),
    FamilyParameter("main_speed", 22.0, 33.0, "m/s", "start speed on the motorway"),
    FamilyParameter("offset", -1.5, 1.5, "s", "how much later the first motorway CAV is due at the nose"),
    FamilyParameter("ramp_headway", 0.8, 2.0, "s", "time headway of CAVs on the ramp"),
    FamilyParameter("main_headway", 0.6, 1.2, "s", "time headway of CAVs on the motorway"),
    FamilyParameter("change_at", 10.0, 100.0, "m", "where ramp CAVs leave the acceleration lane, from the nose"),
    FamilyParameter("right_flow", 0.0, 1200.0, "veh/h", "traffic on the right lane"),
    FamilyParameter("left_flow", 0.0, 1500.0, "veh/h", "traffic on the left lane"),
    FamilyParameter("ramp_flow", 0.0, 500.0, "veh/h", "traffic on the ramp"),
)


def _stage(values: Values, seed: str) -> FamilyScene:
    roads = load_network(NETWORK)
    right, left = (find_lane_path(roads, f"main_{i}", f"after_{i}") for i in (0, 1))
    ramp = find_lane_path(roads, "ramp_0", "after_0")
    nose_m = find_lane_start(roads, right, "merge_1")
    due_s = values["ramp_distance"] / values["ramp_speed"] + values["offset"]
    main_m = nose_m - due_s * values["main_speed"]
    on_left = round(values["main_cavs"]) // 3
    main = (values["main_speed"], values["main_headway"])
    goals = [find_lane_start(roads, chain, chain[-1]) + GOAL_M for chain in (ramp, right, left)]
    ramp_m = find_lane_start(roads, ramp, "merge_0") - values["ramp_distance"]
    change = RouteLaneChange(values["change_at"], CHANGE_M)
    egos = build_platoons(
        roads,
        (
            Platoon(
                ramp,
                round(values["ramp_cavs"]),
                ramp_m,
                goals[0],
                values["ramp_speed"],
                values["ramp_headway"],
                change,
            ),
            Platoon(right, round(values["main_cavs"]) - on_left, main_m, goals[1], *main),
            Platoon(left, on_left, main_m - 6.0, goals[2], *main),
        ),
    )
    flows = (
        TrafficFlow(right, values["right_flow"], MIXED),
        TrafficFlow(left, values["left_flow"], CARS),
        TrafficFlow(ramp[: ramp.index("merge_0")], values["ramp_flow"], CARS),
    )
    vehicles = build_flows(roads, flows, seed, egos)
    return FamilyScene(roads, egos, vehicles)


FAMILY = ScenarioFamily(
    category="motorway-merge",
    description="CAVs merge from a ramp behind an earth bank into motorway traffic at 22 to 33 m/s.",
    parameters=PARAMETERS,
    stage=_stage,
)
