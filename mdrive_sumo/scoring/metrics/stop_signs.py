"""Stop signs run over (protocol 7.7)."""

from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.roads.road_map import Lane, RoadMap
from mdrive_sumo.scoring.metrics.ego_track import Track
from mdrive_sumo.scoring.metrics.infraction import Infraction

NEAR_M = 50.0
AHEAD_M = 20
"""The original looks at the centre and at 20 lane points ahead of it, 1 m apart."""
STOPPED_SPEED = 0.1
"""[m/s]"""


@dataclass(frozen=True)
class _Sign:
    """A stop sign of a map, with what its rule needs."""

    box: StopSignBox
    line: tuple[float, float]
    """Middle of the stop line [m]."""
    lane: Lane


def stop_signs(track: Track) -> tuple[Infraction, ...]:
    """Stop signs whose box the CAV went through without standing (below 0.1 m/s).

    A sign is dealt with, one at a time, from the tick after it comes into reach until it is out of reach
    again; what counts is whether the centre was in the box and whether the CAV stood at any time in between.
    In reach is a sign less than 50 m away if the centre, or one of 20 points ahead of it along its nearest
    lane and any way on from there, is in the box. A CAV that faces against its lane (over 90 degrees) meets
    no sign: the guard is the original's, without it cutting a corner through an oncoming lane's box would
    count. A network whose signs are unknown yields none.
    """
    signs = (_sign(track.roads, box) for box in track.roads.stop_signs or ())
    near = [sign for sign in signs if (_distance(track, sign.line) < NEAR_M).any()]
    if not near:
        return ()
    inside = np.stack([_inside(track, sign) for sign in near])
    reach = np.stack([_in_reach(track, sign) for sign in near]) | inside
    reach &= np.stack([_distance(track, sign.line) < NEAR_M for sign in near])
    facing = np.abs(wrap_angles(track.yaw - track.nearest.yaw)) < np.pi / 2
    return _ran_over(track, near, reach, inside, facing)


def _ran_over(track: Track, signs: list[_Sign], reach: Bool, inside: Bool, facing: Bool) -> tuple[Infraction, ...]:
    """The original's state machine; reach and inside (S, n), facing (n,)."""
    found: list[Infraction] = []
    target: int | None = None
    entered = stood = False
    for tick in range(len(facing)):
        if target is None:
            if facing[tick] and reach[:, tick].any():
                target, entered, stood = int(reach[:, tick].argmax()), False, False
            continue
        stood = stood or abs(float(track.speed[tick])) < STOPPED_SPEED
        entered = entered or bool(inside[target, tick])
        if not reach[target, tick]:
            if entered and not stood:
                found.append(track.event("stop-sign", tick, signs[target].box.id))
            target = None
    return tuple(found)


def _distance(track: Track, point: tuple[float, float]) -> Float:
    return np.hypot(track.xy[:, 0] - point[0], track.xy[:, 1] - point[1])


def _inside(track: Track, sign: _Sign) -> Bool:
    """Per tick (n,): whether the centre is in the sign's box, a rectangle along the lane at its line."""
    yaw = sign.lane.centre.yaw_at(sign.box.line_pos_m)
    dx, dy = (track.xy - sign.line).T
    back = -(dx * np.cos(yaw) + dy * np.sin(yaw))
    side = np.abs(dy * np.cos(yaw) - dx * np.sin(yaw))
    return (back >= 0.0) & (back <= sign.box.length_m) & (side <= sign.lane.width / 2)


def _in_reach(track: Track, sign: _Sign) -> Bool:
    """Per tick (n,): whether one of the points 1, 2 ... 20 m ahead along the lanes lies in the box."""
    reach = np.zeros(len(track.xy), dtype=np.bool_)
    starts = _leading_to(track.roads, sign.lane)
    for index in np.unique(track.nearest.lane):
        lane = track.roads.driving[index]
        if lane.id in starts:
            on = np.flatnonzero(track.nearest.lane == index)
            line = shapely.LineString(lane.centre.xy)
            station = starts[lane.id] + shapely.line_locate_point(line, shapely.points(track.xy[on]))
            left = sign.box.line_pos_m - station
            first = np.maximum(np.ceil(left - sign.box.length_m), 1.0)
            reach[on] = first <= np.minimum(np.floor(left), AHEAD_M)
    return reach


def _sign(roads: RoadMap, box: StopSignBox) -> _Sign:
    lane = roads.lanes[box.lane]
    return _Sign(box, lane.centre.at(box.line_pos_m), lane)


def _leading_to(roads: RoadMap, lane: Lane) -> dict[str, float]:
    """Where [m] on `lane`, seen from its start, it and the lanes close before it begin: 0 or negative."""
    starts, queue = {lane.id: 0.0}, [lane]
    while queue:
        here = queue.pop(0)
        if starts[here.id] > -AHEAD_M:
            for before in roads.driving:
                if here.id in before.successors and before.id not in starts:
                    starts[before.id] = starts[here.id] - before.centre.length
                    queue.append(before)
    return starts
