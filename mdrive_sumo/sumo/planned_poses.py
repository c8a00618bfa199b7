"""Planned poses of vehicles with a schedule: the schedule mapped onto the route, without disturbances."""

# pyright: basic
# Because libsumo has no type information.
from collections.abc import Iterable, Iterator

import libsumo
import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.sumo.insertion import find_junction_lanes
from mdrive_sumo.sumo.logged_poses import LoggedPoses

LANE_CHANGE_HALF_LENGTH_M = 8.0
"""A lane change extends this far [m] before and behind its position."""


def build_planned_poses(vehicles: Iterable[BackgroundVehicle], roads: RoadMap) -> LoggedPoses:
    """Return the poses in all ticks of the schedules. Call after the start of SUMO, whose lane lengths are used."""
    chosen = tuple(sorted((one for one in vehicles if one.schedule), key=lambda one: one.id))
    ticks = max((round(one.schedule.progress[-1][0] / DT) + 1 for one in chosen if one.schedule), default=0)
    poses, present = np.zeros((len(chosen), ticks, 4)), np.zeros((len(chosen), ticks), dtype=np.bool_)
    for i, vehicle in enumerate(chosen):
        poses[i], present[i] = _sample_schedule(vehicle, ticks, roads)
    return LoggedPoses(chosen, poses, present, np.array([(v.length, v.width) for v in chosen]).reshape(-1, 2))


def _sample_schedule(vehicle: BackgroundVehicle, ticks: int, roads: RoadMap) -> tuple[Float, Bool]:
    assert vehicle.schedule is not None
    times, positions = np.array(vehicle.schedule.progress).T
    now = np.arange(ticks) * DT
    position = np.interp(now, times, positions)
    pieces = list(_iterate_points(vehicle, roads))
    if not pieces:
        return np.zeros((ticks, 4)), np.zeros(ticks, dtype=np.bool_)
    along, x, y = np.concatenate(pieces).T
    front, back = (
        np.stack((np.interp(station, along, x), np.interp(station, along, y)))
        for station in (position, position - vehicle.length)
    )
    centre, ahead = (front + back) / 2, front - back
    speed = np.gradient(position, DT) if ticks > 1 else np.zeros(ticks)
    poses = np.stack((*centre, portable.atan2(ahead[1], ahead[0]), speed), axis=1)
    return poses, (now > times[0] - 1e-6) & (now < times[-1] + 1e-6)


def _iterate_points(vehicle: BackgroundVehicle, roads: RoadMap) -> Iterator[Float]:
    """Yield points (N, 3) of the route: distance [m] as SUMO measures, increasing, and x, y [m]."""
    lane: Lane | None = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    begin, since = -vehicle.depart_pos_m, -np.inf
    following = list(vehicle.edges[1:])
    while lane is not None:
        length = libsumo.lane.getLength(lane.id)
        for change_m, index in _iterate_lane_changes(vehicle, begin, begin + length):
            target = roads.lanes.get(f"{lane.edge}_{index}")
            if target is not None and target is not lane and not lane.junction:
                yield _select_points(lane, begin, length, since, change_m - LANE_CHANGE_HALF_LENGTH_M)
                lane, since = target, change_m + LANE_CHANGE_HALF_LENGTH_M
        yield _select_points(lane, begin, length, since, begin + length)
        begin, since = begin + length, max(since, begin)
        if lane.edge == vehicle.edges[-1] or not following:
            return
        lane = _find_next_lane(lane, following[0], roads)
        if lane is not None and lane.edge == following[0]:
            following.pop(0)


def _iterate_lane_changes(vehicle: BackgroundVehicle, begin: float, end: float) -> Iterator[tuple[float, int]]:
    assert vehicle.schedule is not None
    return ((change_m, index) for change_m, index in vehicle.schedule.lanes if begin <= change_m < end)


def _find_next_lane(lane: Lane, edge: str, roads: RoadMap) -> Lane | None:
    """Return the next lane towards an edge; None if no successor leads there."""
    for pieces in lane.successors:
        if roads.lanes[pieces].edge == edge or find_junction_lanes(pieces, edge, roads):
            return roads.lanes[pieces]
    return None


def _select_points(lane: Lane, begin: float, length: float, since: float, until: float) -> Float:
    """Return the points of a lane between distances `since` and `until`; the lane begins at distance `begin`."""
    along = begin + lane.centre.s * length / lane.centre.length
    chosen = (along >= since) & (along <= until)
    return np.column_stack((along, lane.centre.xy))[chosen]
