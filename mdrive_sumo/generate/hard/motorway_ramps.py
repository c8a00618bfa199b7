"""Families on motorways: CAVs merge from a ramp at speed, or exchange lanes with others on a short auxiliary lane."""

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    load_network,
    stage_flows,
)
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.worlds.placement.cavs import Platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes, RouteLaneChange, find_lane_start
from mdrive_sumo.worlds.streams.lane_flows import CARS, MIXED, TrafficFlow

MERGE_CHANGE_M, WEAVE_CHANGE_M = 80.0, 60.0
"""[m] Length of a lane change: 3.5 m sideways at 30 m/s, or 22 m/s, with a lateral acceleration of 3 m/s2."""
MERGE_GOAL_M, WEAVE_GOAL_M = 60.0, 50.0
"""[m] Distance of the goals behind the end of the acceleration lane or weaving section."""
MERGE_PARAMETERS = (
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
WEAVE_PARAMETERS = (
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


def _find_main_lanes(roads: RoadMap) -> tuple[Lanes, Lanes]:
    """Return the right and the left lane of the motorway."""
    right, left = (find_lane_path(roads, f"main_{i}", f"after_{i}") for i in (0, 1))
    return right, left


def _find_leads(roads: RoadMap, ramp: Lanes, section: str, values: Values) -> tuple[float, float]:
    """Return the stations [m] of the first CAVs on the ramp and on the motorway; `section`: edge behind the nose."""
    due_s = values["ramp_distance"] / values["ramp_speed"] + values["offset"]
    ramp_m = find_lane_start(roads, ramp, f"{section}_0") - values["ramp_distance"]
    return ramp_m, find_lane_start(roads, _find_main_lanes(roads)[0], f"{section}_1") - due_s * values["main_speed"]


def _stage_merge(values: Values, seed: str) -> FamilyScene:
    roads = load_network("hard_motorway_merge")
    right, left = _find_main_lanes(roads)
    ramp = find_lane_path(roads, "ramp_0", "after_0")
    ramp_m, main_m = _find_leads(roads, ramp, "merge", values)
    on_left = round(values["main_cavs"]) // 3
    main = (values["main_speed"], values["main_headway"])
    merging = (values["ramp_speed"], values["ramp_headway"], RouteLaneChange(values["change_at"], MERGE_CHANGE_M))
    goals = [find_lane_start(roads, chain, chain[-1]) + MERGE_GOAL_M for chain in (ramp, right, left)]
    platoons = (
        Platoon(ramp, round(values["ramp_cavs"]), ramp_m, goals[0], *merging),
        Platoon(right, round(values["main_cavs"]) - on_left, main_m, goals[1], *main),
        Platoon(left, on_left, main_m - 6.0, goals[2], *main),
    )
    flows = (
        TrafficFlow(right, values["right_flow"], MIXED),
        TrafficFlow(left, values["left_flow"], CARS),
        TrafficFlow(ramp[: ramp.index("merge_0")], values["ramp_flow"], CARS),
    )
    return stage_flows(roads, platoons, flows, seed)


def _stage_weave(values: Values, seed: str) -> FamilyScene:
    roads = load_network("hard_weave")
    right, left = _find_main_lanes(roads)
    enter = find_lane_path(roads, "on_ramp_0", "after_0")
    leave = find_lane_path(roads, "main_0", "off_ramp_0")
    ramp_m, main_m = _find_leads(roads, enter, "weave", values)
    main = (values["main_speed"], values["main_headway"])
    entering = (values["ramp_speed"], values["ramp_headway"], RouteLaneChange(values["enter_at"], WEAVE_CHANGE_M))
    leaving = (*main, RouteLaneChange(values["leave_at"], WEAVE_CHANGE_M))
    goals = [find_lane_start(roads, chain, chain[-1]) + WEAVE_GOAL_M for chain in (enter, leave, left)]
    platoons = (
        Platoon(enter, round(values["entering"]), ramp_m, goals[0], *entering),
        Platoon(leave, round(values["leaving"]), main_m, goals[1], *leaving),
        Platoon(left, round(values["passing"]), main_m + 8.0, goals[2], *main),
    )
    flows = (TrafficFlow(right, values["right_flow"], MIXED), TrafficFlow(left, values["left_flow"], CARS))
    return stage_flows(roads, platoons, flows, seed)


MERGE_FAMILY = ScenarioFamily(
    "motorway-merge",
    "CAVs merge from a ramp behind an earth bank into motorway traffic at 22 to 33 m/s.",
    MERGE_PARAMETERS,
    _stage_merge,
)
WEAVE_FAMILY = ScenarioFamily(
    "motorway-weave",
    "CAVs that enter and CAVs that leave a motorway exchange lanes within 190 m.",
    WEAVE_PARAMETERS,
    _stage_weave,
)
