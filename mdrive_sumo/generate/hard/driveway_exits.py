"""Families in which cars come out of driveways or farm tracks without a look, each in front of one CAV."""

from collections.abc import Sequence
from functools import lru_cache, partial

import shapely

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import ScenarioFamily, Values
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, find_junction_ways
from mdrive_sumo.generate.hard.step_outs import Exit, Side, StepOutKind, change_bounds, stage_step_outs
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_parked_vehicle
from mdrive_sumo.worlds.placement.lane_chains import Lanes, build_route_line, compute_pose, find_conflict_stations
from mdrive_sumo.worlds.placement.occupancy import overlaps_building

MINOR_SHARE = 0.7
"""A driveway or track has a limit of at most this share of that of the road that it joins."""
RIM_M = 6.0
"""[m] An exit lies at least this far from the end of the way."""
MOUTH_M = 4.5
"""[m] Half of the mouth of a driveway at the kerb: a lane of 2.75 m and most of a corner of 5.5 m."""
KERB_M = 0.2
"""[m] From the edge of the lane to a parked van, which stands half on the pavement."""
LANE_GAP_M = 1.0
"""[m] No parked van stands nearer to the centre line of a lane."""


@lru_cache(maxsize=256)
def find_exits(roads: RoadMap, lanes: Lanes) -> tuple[tuple[Exit, ...], ...]:
    """Return the ways out of each driveway or track at the right of a chain of lanes, in its order."""
    line = build_route_line(roads, lanes)
    limit = roads.lanes[lanes[0]].speed_limit
    found: dict[str, list[Exit]] = {}
    for way in find_junction_ways(roads):
        if way.limit <= MINOR_SHARE * limit and _is_at_right(roads, lanes, way):
            met = find_conflict_stations(build_route_line(roads, way.lanes), line)
            if met is not None and met[1] < line.curve.length - RIM_M:
                one = Exit(met[1], 0.0, 0.0, path=way.lanes, path_m=met[0])
                found.setdefault(way.approach, []).append(one)
    return tuple(tuple(exits) for exits in sorted(found.values(), key=lambda exits: exits[0].station))


def _is_at_right(roads: RoadMap, lanes: Lanes, way: JunctionWay) -> bool:
    x, y = roads.lanes[way.approach].centre.at(0.0)
    return way.approach not in lanes and build_route_line(roads, lanes).curve.project(x, y)[1] < 0.0


def _choose_exits(roads: RoadMap, lanes: Lanes, other: Lanes, values: Values) -> list[Exit]:
    """Return a way out of each driveway: into the direction of the CAVs, or across to the other one."""
    del other
    joins = values["free_m"] < 0.5
    return [exits[0 if joins else -1] for exits in find_exits(roads, lanes)]


def _park_vans(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    """Return vans at the kerb before and behind the mouths of the driveways."""
    del seed
    made: list[Actor] = []
    length, width = BODY_SIZES["van"]
    for side in sides:
        line = build_route_line(roads, side.lanes)
        offset = -(roads.lanes[side.lanes[0]].width / 2 + KERB_M + width / 2)
        for one in side.exits:
            mouth, _ = line.curve.project(*roads.lanes[one.path[0]].centre.at(0.0))
            for j in range(round(values["vans"])):
                step = MOUTH_M + values["run_up_m"] + length / 2 + j * (length + 1.0)
                for at in (mouth - step, mouth + step):
                    pose = compute_pose(roads, side.lanes, at, offset)
                    van = build_parked_vehicle(f"parked{len(made)}", "van", pose, mirrored=False)
                    if length < at < line.curve.length - length and _is_free(roads, van, made):
                        made.append(van)
    return made


def _is_free(roads: RoadMap, van: Actor, others: Sequence[Actor]) -> bool:
    """Return whether a parked van is clear of lanes, buildings and other vans."""
    box = build_user_box(van)
    lanes = roads.find_lanes_near(van.start.x, van.start.y, van.length)
    return (
        all(box.distance(shapely.LineString(lane.centre.xy)) > LANE_GAP_M for lane in lanes)
        and all(box.distance(build_user_box(other)) > LANE_GAP_M / 2 for other in others)
        and not overlaps_building(box, roads)
    )


def _build_nothing(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    """Return nothing: hedges and barns of the place hide the tracks."""
    del roads, sides, values, seed
    return []


DRIVEWAY = StepOutKind(BODIES["car"], _choose_exits, _park_vans)
TRACK = StepOutKind(BODIES["van"], _choose_exits, _build_nothing)
_VEHICLES = {"people": (1.0, 1.0), "late_s": (-0.4, 0.8), "free_m": (0.0, 1.0), "arrival_s": (2.5, 5.0)}
FAMILIES = (
    ScenarioFamily(
        "driveway-exit",
        "Cars leave driveways between parked vans or hedges without a look, each in front of one CAV.",
        (
            PlaceChoice("residential_street", {"junctions": 0, "yards": 4, "gardens": "hedges", "limit_kmh": 30.0}),
            PlaceChoice("residential_street", {"junctions": 1, "yards": 3, "gardens": "walls", "limit_kmh": 30.0}),
            PlaceChoice("driveways", {"speed_kmh": 50, "driveways": 5}),
        ),
        change_bounds(
            **_VEHICLES,
            walking=(3.0, 6.0),
            along_m=(7.0, 16.0),
            run_up_m=(0.0, 1.5),
            vans=(1.0, 3.0),
            spacing_m=(5.0, 30.0),
        ),
        partial(stage_step_outs, DRIVEWAY),
    ),
    ScenarioFamily(
        "farm-track",
        "Vans come out of farm tracks behind hedges and barns without a look, each in front of one CAV.",
        (
            PlaceChoice("country_road", {"tracks": 3, "limit_kmh": 80.0, "roadside": "hedges", "keeps_sight": False}),
            PlaceChoice("country_road", {"tracks": 2, "limit_kmh": 100.0, "roadside": "barns", "keeps_sight": False}),
            PlaceChoice("country_road", {"tracks": 2, "limit_kmh": 80.0, "roadside": "hamlet", "keeps_sight": False}),
        ),
        change_bounds(
            **_VEHICLES,
            walking=(4.0, 9.0),
            along_m=(10.0, 30.0),
            spacing_m=(5.0, 60.0),
        ),
        partial(stage_step_outs, TRACK),
    ),
)
