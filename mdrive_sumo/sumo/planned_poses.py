"""Where vehicles with a schedule will be if nothing disturbs them: their schedules laid along their routes."""

# pyright: basic
from collections.abc import Iterable, Iterator

import libsumo
import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.sumo.insertion import through
from mdrive_sumo.sumo.logged_poses import Logs

EASE_M = 8.0
"""A lane change is drawn from so far before its place to so far behind it."""


def plans_of(vehicles: Iterable[BackgroundVehicle], roads: RoadMap) -> Logs:
    """Their boxes in all ticks of their schedules. After the start of SUMO, whose lengths of lanes they go by."""
    chosen = tuple(sorted((one for one in vehicles if one.schedule), key=lambda one: one.id))
    ticks = max((round(one.schedule.progress[-1][0] / DT) + 1 for one in chosen if one.schedule), default=0)
    poses, present = np.zeros((len(chosen), ticks, 4)), np.zeros((len(chosen), ticks), dtype=np.bool_)
    for i, vehicle in enumerate(chosen):
        poses[i], present[i] = _planned(vehicle, ticks, roads)
    return Logs(chosen, poses, present, np.array([(v.length, v.width) for v in chosen]).reshape(-1, 2))


def _planned(vehicle: BackgroundVehicle, ticks: int, roads: RoadMap) -> tuple[Float, Bool]:
    assert vehicle.schedule is not None
    times, places = np.array(vehicle.schedule.progress).T
    now = np.arange(ticks) * DT
    place = np.interp(now, times, places)
    way = list(_points(vehicle, roads))
    if not way:
        return np.zeros((ticks, 4)), np.zeros(ticks, dtype=np.bool_)
    along, x, y = np.concatenate(way).T
    front, back = (
        np.stack((np.interp(at, along, x), np.interp(at, along, y))) for at in (place, place - vehicle.length)
    )
    centre, ahead = (front + back) / 2, front - back
    speed = np.gradient(place, DT) if ticks > 1 else np.zeros(ticks)
    poses = np.stack((*centre, np.arctan2(ahead[1], ahead[0]), speed), axis=1)
    return poses, (now > times[0] - 1e-6) & (now < times[-1] + 1e-6)


def _points(vehicle: BackgroundVehicle, roads: RoadMap) -> Iterator[Float]:
    """Points (N, 3) of its way: distance along the route [m] as SUMO measures, x, y [m]; distances grow."""
    lane: Lane | None = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    begin, since = -vehicle.depart_pos_m, -np.inf
    following = list(vehicle.edges[1:])
    while lane is not None:
        length = libsumo.lane.getLength(lane.id)
        for at, index in _changes(vehicle, begin, begin + length):
            target = roads.lanes.get(f"{lane.edge}_{index}")
            if target is not None and target is not lane and not lane.junction:
                yield _piece(lane, begin, length, since, at - EASE_M)
                lane, since = target, at + EASE_M
        yield _piece(lane, begin, length, since, begin + length)
        begin, since = begin + length, max(since, begin)
        if lane.edge == vehicle.edges[-1] or not following:
            return
        lane = _onward(lane, following[0], roads)
        if lane is not None and lane.edge == following[0]:
            following.pop(0)


def _changes(vehicle: BackgroundVehicle, begin: float, end: float) -> Iterator[tuple[float, int]]:
    assert vehicle.schedule is not None
    return ((at, index) for at, index in vehicle.schedule.lanes if begin <= at < end)


def _onward(lane: Lane, edge: str, roads: RoadMap) -> Lane | None:
    """The next lane on the way to an edge; None where none of the lane's ways leads there."""
    for way in lane.successors:
        if roads.lanes[way].edge == edge or through(way, edge, roads):
            return roads.lanes[way]
    return None


def _piece(lane: Lane, begin: float, length: float, since: float, until: float) -> Float:
    """Points of a lane that begins at distance `begin`, from `since` to `until`."""
    along = begin + lane.centre.s * length / lane.centre.length
    chosen = (along >= since) & (along <= until)
    return np.column_stack((along, lane.centre.xy))[chosen]
