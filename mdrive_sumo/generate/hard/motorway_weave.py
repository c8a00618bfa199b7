"""Family `motorway-weave`: CAVs that enter and CAVs that leave a motorway exchange lanes on a short auxiliary lane."""

from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values, load_network
from mdrive_sumo.roads import find_lane_path
from mdrive_sumo.worlds.placement.cavs import Platoon, build_platoons
from mdrive_sumo.worlds.placement.lane_chains import RouteLaneChange, find_lane_start
from mdrive_sumo.worlds.streams.lane_flows import CARS, MIXED, TrafficFlow, build_flows

NETWORK = "hard_weave"
CHANGE_M = 60.0
"""[m] Length of a lane change: 3.5 m sideways at 22 m/s with a lateral acceleration of 3 m/s2."""
GOAL_M = 50.0
"""[m] Distance of the goals behind the weaving section."""
PARAMETERS = (
    FamilyParameter("entering", 1.0, 3.0, "", "number of CAVs that enter, rounded"),
    FamilyParameter("leaving", 1.0, 3.0, "", "number of CAVs that leave, rounded"),
    FamilyParameter("passing", 0.0, 2.0, "", "number of CAVs that stay on the left lane, rounded"),
    FamilyParameter("ramp_distance", 60.0, 140.0, "m", "distance of the first entering CAV from the nose"),
    FamilyParameter("ramp_speed", 14.0, 19.0, "m/s", "start speed on the ramp"),
    FamilyParameter("main_speed", 18.0, 27.0, "m/s", "start speed on the motorway"),
    FamilyParameter("offset", -1.0, 1.0, "s", "how much later the first leaving CAV is due at the nose"),
    FamilyParameter("ramp_headway", 0.8, 1.8, "s", "time headway of entering CAVs"),
    FamilyParameter("main_headway", 0.6, 1.2, "s", "time headway of CAVs on the motorway"),
    FamilyParameter("enter_at", 5.0, 110.0, "m", "where entering CAVs change lanes, from the nose"),
    FamilyParameter("leave_at", 5.0, 110.0, "m", "where leaving CAVs change lanes, from the nose"),
    FamilyParameter("right_flow", 0.0, 1000.0, "veh/h", "traffic on the right lane"),
    FamilyParameter("left_flow", 0.0, 1400.0, "veh/h", "traffic on the left lane"),
)


def _stage(values: Values, seed: str) -> FamilyScene:
    roads = load_network(NETWORK)
    enter = find_lane_path(roads, "on_ramp_0", "after_0")
    leave = find_lane_path(roads, "main_0", "off_ramp_0")
    right, left = (find_lane_path(roads, f"main_{i}", f"after_{i}") for i in (0, 1))
    due_s = values["ramp_distance"] / values["ramp_speed"] + values["offset"]
    main_m = find_lane_start(roads, right, "weave_1") - due_s * values["main_speed"]
    ramp_m = find_lane_start(roads, enter, "weave_0") - values["ramp_distance"]
    enter_goal, leave_goal, left_goal = (
        find_lane_start(roads, chain, chain[-1]) + GOAL_M for chain in (enter, leave, left)
    )
    main = (values["main_speed"], values["main_headway"])
    entering = (values["ramp_speed"], values["ramp_headway"], RouteLaneChange(values["enter_at"], CHANGE_M))
    egos = build_platoons(
        roads,
        (
            Platoon(enter, round(values["entering"]), ramp_m, enter_goal, *entering),
            Platoon(
                leave,
                round(values["leaving"]),
                main_m,
                leave_goal,
                *main,
                RouteLaneChange(values["leave_at"], CHANGE_M),
            ),
            Platoon(left, round(values["passing"]), main_m + 8.0, left_goal, *main),
        ),
    )
    flows = (TrafficFlow(right, values["right_flow"], MIXED), TrafficFlow(left, values["left_flow"], CARS))
    vehicles = build_flows(roads, flows, seed, egos)
    return FamilyScene(roads, egos, vehicles)


FAMILY = ScenarioFamily(
    category="motorway-weave",
    description="CAVs that enter and CAVs that leave a motorway exchange lanes within 190 m.",
    parameters=PARAMETERS,
    stage=_stage,
)
