"""Parts that families of the hard tier share: CAVs and poses on chains of lanes, crossing road users, the scenario."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline, box_corners
from mdrive_sumo.generate.hard.family import BUCKET, FamilyCandidate, ScenarioFamily, check_candidate
from mdrive_sumo.generate.pipeline import PipelineStage, ProposalRejected
from mdrive_sumo.generate.spawn_points import RouteLine, find_conflict_stations
from mdrive_sumo.roads import RoadMap, build_lane_route, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    KindName,
    LaneMotion,
    PathMotion,
    PositionTrigger,
    StandingMotion,
    StartMotion,
    Trigger,
)
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps

BODY_SIZES: Mapping[str, tuple[float, float]] = {
    "car": (4.6, 1.85),
    "van": (5.9, 2.0),
    "truck": (9.5, 2.5),
    "bus": (12.0, 2.55),
}
"""Length and width [m] of vehicles by model; widths without mirrors."""
WALKER_SIZES: Mapping[KindName, tuple[float, float]] = {"pedestrian": (0.5, 0.5), "cyclist": (1.8, 0.6)}
"""Length and width [m] of crossing road users."""
LEAST_CAVS, MOST_CAVS = 2, 12
"""CAVs of a scenario of the hard tier (docs/hard.md)."""
Lanes = tuple[str, ...]
"""SUMO lane ids in driving order, junction lanes included; a lane change lists both lanes. `roads.find_lane_path`
finds them from the first to the last lane."""


@dataclass(frozen=True, slots=True)
class RouteLaneChange:
    """The lane change of a route: where it begins on the lane that it leaves [m], and its length [m]."""

    at_m: float
    length_m: float


def read_values(family: ScenarioFamily, candidate: FamilyCandidate) -> dict[str, float]:
    """Return the candidate's values by parameter name. Raises InputError for values out of bounds."""
    check_candidate(family, candidate)
    names = [parameter.name for parameter in family.parameters]
    return dict(zip(names, candidate.values, strict=True))


def load_network(name: str) -> RoadMap:
    """Return a packaged network."""
    return load_road_map(find_network_folder(name))


@lru_cache(maxsize=512)
def _build_line(roads: RoadMap, lanes: Lanes, change: RouteLaneChange | None = None) -> tuple[Polyline, Float]:
    """Return the route along whole lanes, and the lane direction [rad] at every metre."""
    end_m = roads.lanes[lanes[-1]].centre.length
    if change is None:
        route = build_lane_route(roads, lanes, 0.0, end_m)
    else:
        changes = {
            i: change.at_m
            for i, (here, there) in enumerate(pairwise(lanes))
            if there in (roads.lanes[here].left, roads.lanes[here].right)
        }
        route = build_lane_route(roads, lanes, 0.0, end_m, changes, change.length_m)
    return Polyline(route.xy), route.yaw


def compute_chain_length(roads: RoadMap, lanes: Lanes) -> float:
    """Return the length [m] of a chain of lanes."""
    return _build_line(roads, lanes)[0].length


def find_station(roads: RoadMap, lanes: Lanes, x: float, y: float) -> float:
    """Return the station [m] along a chain of lanes that is nearest to a point."""
    return _build_line(roads, lanes)[0].project(x, y)[0]


def find_lane_start(roads: RoadMap, lanes: Lanes, lane: str) -> float:
    """Return the station [m] at which a lane of the chain begins, e.g. the first lane inside a junction."""
    return find_station(roads, lanes, *roads.lanes[lane].centre.at(0.0))


def compute_pose(roads: RoadMap, lanes: Lanes, station: float, offset: float = 0.0) -> Pose:
    """Return the pose at a station [m] along a chain of lanes, `offset` [m] to its left."""
    line = _build_line(roads, lanes)[0]
    (x, y), yaw = line.at(station), line.yaw_at(station)
    return Pose(
        x=round(x - offset * portable.sin(yaw), 3), y=round(y + offset * portable.cos(yaw), 3), yaw=round(yaw, 4)
    )


def build_cav(roads: RoadMap, name: str, lanes: Lanes, start_m: float, goal_m: float, speed: float) -> Ego:
    """Return a CAV that drives from one station [m] of a chain of lanes to another and starts at `speed` [m/s].

    Lane changes take 20 m, which suits urban speeds. Raises ProposalRejected if it does not lie on the chain.
    """
    return build_changing_cav(roads, name, (lanes, None), (start_m, goal_m), speed)


def build_changing_cav(
    roads: RoadMap, name: str, way: tuple[Lanes, RouteLaneChange | None], drive: tuple[float, float], speed: float
) -> Ego:
    """Return a CAV as `build_cav` does; `way`: chain of lanes with its lane change; `drive`: stations [m] of both ends.

    Raises ProposalRejected if it does not lie on the chain.
    """
    (lanes, change), (start_m, goal_m) = way, drive
    line, yaw = _build_line(roads, lanes, change)
    if not 0.0 <= start_m < goal_m - 10.0 or goal_m > line.length:
        raise ProposalRejected(
            PipelineStage.SPAWNS,
            f"{name}: expected at least 10 m of route within {line.length:.0f} m of lanes,"
            f" found {start_m:.0f} to {goal_m:.0f} m",
        )
    stations = np.arange(start_m, goal_m, 1.0)
    yaws = np.interp(stations, np.arange(len(yaw)), yaw)
    xy = [line.at(station) for station in stations.tolist()]
    points = tuple((round(x, 3), round(y, 3), round(a, 4)) for (x, y), a in zip(xy, yaws.tolist(), strict=True))
    x, y, direction = points[0]
    used = _select_lanes(roads, lanes, start_m, goal_m)
    return Ego(id=name, start=Pose(x=x, y=y, yaw=direction), start_speed=round(speed, 2), lanes=used, route=points)


def _select_lanes(roads: RoadMap, lanes: Lanes, start_m: float, goal_m: float) -> Lanes:
    """Return the lanes of the chain between two stations."""
    begins, begin = [0.0], 0.0
    for here, there in pairwise(lanes):
        lane = roads.lanes[here]
        begin += 0.0 if there in (lane.left, lane.right) else lane.centre.length
        begins.append(begin)
    ends = [begin + roads.lanes[lane].centre.length for begin, lane in zip(begins, lanes, strict=True)]
    first = next((i for i, end in enumerate(ends) if end > start_m), 0)
    last = max(i for i, begin in enumerate(begins) if begin < goal_m)
    return lanes[first : last + 1]


def build_platoon(
    roads: RoadMap, names: Sequence[str], lanes: Lanes, fronts: tuple[float, float], drive: tuple[float, float]
) -> list[Ego]:
    """Return CAVs that follow each other on a chain of lanes: as many of the names as have room.

    `fronts`: station [m] of the first and gap [m] between centres; `drive`: goal [m], the same for all, and speed.
    """
    stations = [fronts[0] - k * fronts[1] for k in range(len(names))]
    placed = [(name, station) for name, station in zip(names, stations, strict=True) if station >= 0.0]
    return [build_cav(roads, name, lanes, station, drive[0], drive[1]) for name, station in placed]


def find_conflict(roads: RoadMap, lanes: Lanes, others: Lanes) -> tuple[float, float]:
    """Return the stations [m] on two chains of lanes at which they first come together. Raises InputError if never."""
    one, other = (RouteLine(_build_line(roads, chain)[0].xy, 0.0) for chain in (lanes, others))
    if (met := find_conflict_stations(one, other)) is None:
        raise InputError(f"network {roads.name}: expected chains of lanes that meet, found {lanes} and {others}")
    return met


def build_driving_actor(roads: RoadMap, name: str, model: str, drive: tuple[Lanes, float, float]) -> Actor:
    """Return a vehicle that is not connected and drives along lanes; `drive`: lanes, start [m], speed [m/s].

    It stops for what is in its way, and yields to nothing else.
    """
    lanes, start_m, speed = drive
    length, width = BODY_SIZES[model]
    used = _select_lanes(roads, lanes, start_m, compute_chain_length(roads, lanes))
    return Actor(
        id=name,
        kind="vehicle",
        model=model,
        length=length,
        width=width,
        start=compute_pose(roads, lanes, start_m),
        motion=LaneMotion(lanes=used, speed=round(speed, 2), start_speed=round(speed, 2)),
    )


def build_vehicle_actor(name: str, model: str, pose: Pose, mirrored: bool = True) -> Actor:
    """Return a standing vehicle of a model of `BODY_SIZES`: parked, or stopped in a lane."""
    length, width = BODY_SIZES[model]
    return Actor(
        id=name, kind="vehicle", model=f"parked-{model}", length=length, width=width, start=pose, mirrored=mirrored
    )


def build_crossing_actor(
    name: str, kind: KindName, points: Sequence[tuple[float, float]], speed: float, trigger: Trigger
) -> Actor:
    """Return a pedestrian or cyclist that waits at the first point [m] and goes through the others when triggered."""
    length, width = WALKER_SIZES[kind]
    (x, y), (x1, y1) = points[0], points[1]
    path = tuple((round(px, 3), round(py, 3)) for px, py in points)
    return Actor(
        id=name,
        kind=kind,
        model="adult" if kind == "pedestrian" else "bicycle",
        length=length,
        width=width,
        start=Pose(x=round(x, 3), y=round(y, 3), yaw=round(portable.atan2(y1 - y, x1 - x), 4)),
        motion=PathMotion(points=path, speed=speed),
        trigger=trigger,
        action=StartMotion(),
    )


def build_arrival_trigger(ego: Ego, distance_m: float) -> PositionTrigger:
    """Return a trigger that fires when a CAV has driven a distance [m] along its route, however long that takes."""
    x, y, _ = ego.route[min(max(round(distance_m), 0), len(ego.route) - 1)]
    return PositionTrigger(vehicle=ego.id, x=x, y=y, radius_m=3.0)


@dataclass(frozen=True, slots=True)
class FamilyTraffic:
    """What a scenario holds beside its CAVs."""

    vehicles: tuple[BackgroundVehicle, ...] = ()
    actors: tuple[Actor, ...] = ()
    rsus: tuple[RoadsideUnit, ...] = ()
    signals: bool = False
    """Whether traffic lights run their programs."""


def build_scenario(
    family: ScenarioFamily, candidate: FamilyCandidate, roads: RoadMap, egos: Sequence[Ego], traffic: FamilyTraffic
) -> Scenario:
    """Return the scenario of a candidate.

    Raises ProposalRejected if it is not sound: fewer than 2 or more than 12 CAVs, off the road, or road users inside
    each other.
    """
    if not LEAST_CAVS <= len(egos) <= MOST_CAVS:
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"expected {LEAST_CAVS} to {MOST_CAVS} CAVs, found {len(egos)}")
    scenario = Scenario(
        id=candidate.scenario_id,
        bucket=BUCKET,
        category=family.category,
        network=roads.name,
        description=family.description,
        signals="program" if traffic.signals else "frozen-green",
        speeds="road",
        egos=tuple(egos),
        background=Background(vehicles=traffic.vehicles),
        actors=traffic.actors,
        rsus=traffic.rsus,
    )
    try:
        check_scenario(scenario, roads)
    except InputError as error:
        raise ProposalRejected(PipelineStage.SOUNDNESS, str(error)) from None
    if inside := next(_find_parked_in_buildings(scenario, roads), None):
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"scenario {scenario.id}: {inside} stands inside a building")
    if overlap := next(find_spawn_overlaps(scenario, roads), None):
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"scenario {scenario.id}: {overlap}")
    return scenario


def _find_parked_in_buildings(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    """Return the ids of standing vehicles that overlap a building."""
    for actor in scenario.actors:
        if isinstance(actor.motion, StandingMotion):
            pose = actor.start
            box = shapely.Polygon(box_corners(pose.x, pose.y, pose.yaw, actor.length, actor.width))
            if any(box.intersects(building) for building in roads.building_shapes):
                yield actor.id
