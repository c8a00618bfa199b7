"""Passing a stop sign without stopping (protocol 7.7)."""

from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.roads.road_map import Lane, RoadMap
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric

SIGN_RANGE_M = 50.0
"""Signs further away than this [m] are ignored."""
CHECKED_AHEAD_M = 20
"""The original checks the centre and 20 lane points ahead of it, 1 m apart."""
STOPPED_SPEED = 0.1
"""[m/s]"""
PENALTY_FACTOR = 0.80
"""Protocol 7.1."""


@dataclass(frozen=True)
class _Sign:
    """A stop sign of a map, with its line and lane."""

    box: StopSignBox
    line: tuple[float, float]
    """Middle of the stop line [m]."""
    lane: Lane


def find_stop_sign_infractions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the stop signs whose box the CAV passed without standing (below 0.1 m/s).

    One sign at a time is active, from the tick after it comes into reach until it is out of reach; the infraction
    depends on whether the centre was in the box and whether the CAV stood in between. A sign less than 50 m away is in
    reach if the centre, or one of 20 points ahead of it along its nearest lane and any successors, is in the box. A CAV
    that faces against its lane (over 90 degrees) activates no sign: the original has this guard, because cutting a
    corner through an oncoming lane's box would count otherwise. A network whose signs are unknown yields none.
    """
    signs = (_build_sign(track.roads, box) for box in track.roads.stop_signs or ())
    near = [sign for sign in signs if (_compute_distances(track, sign.line) < SIGN_RANGE_M).any()]
    if not near:
        return ()
    inside = np.stack([_is_inside(track, sign) for sign in near])
    reach = np.stack([_is_in_reach(track, sign) for sign in near]) | inside
    reach &= np.stack([_compute_distances(track, sign.line) < SIGN_RANGE_M for sign in near])
    facing = np.abs(wrap_angles(track.yaw - track.nearest.yaw)) < np.pi / 2
    return _collect_infractions(track, near, reach, inside, facing)


def _collect_infractions(
    track: EgoTrack, signs: list[_Sign], reach: Bool, inside: Bool, facing: Bool
) -> tuple[InfractionEvent, ...]:
    """Run the original's state machine; reach and inside are (S, n), facing is (n,)."""
    events: list[InfractionEvent] = []
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
                events.append(track.make_infraction("stop-sign", tick, signs[target].box.id, PENALTY_FACTOR))
            target = None
    return tuple(events)


def _compute_distances(track: EgoTrack, point: tuple[float, float]) -> Float:
    return portable.hypot(track.xy[:, 0] - point[0], track.xy[:, 1] - point[1])


def _is_inside(track: EgoTrack, sign: _Sign) -> Bool:
    """Return an (n,) mask: the centre is in the sign's box, a rectangle along the lane at its line."""
    yaw = sign.lane.centre.yaw_at(sign.box.line_pos_m)
    dx, dy = (track.xy - sign.line).T
    cos, sin = portable.cos_sin(yaw)
    back, side = -(dx * cos + dy * sin), np.abs(dy * cos - dx * sin)
    return (back >= 0.0) & (back <= sign.box.length_m) & (side <= sign.lane.width / 2)


def _is_in_reach(track: EgoTrack, sign: _Sign) -> Bool:
    """Return an (n,) mask: one of the points 1, 2 ... 20 m ahead along the lanes lies in the box."""
    reach = np.zeros(len(track.xy), dtype=np.bool_)
    starts = _find_lane_starts(track.roads, sign.lane)
    for index in np.unique(track.nearest.lane):
        lane = track.roads.driving[index]
        if lane.id in starts:
            on = np.flatnonzero(track.nearest.lane == index)
            line = shapely.LineString(lane.centre.xy)
            station = starts[lane.id] + shapely.line_locate_point(line, shapely.points(track.xy[on]))
            left = sign.box.line_pos_m - station
            first = np.maximum(np.ceil(left - sign.box.length_m), 1.0)
            reach[on] = first <= np.minimum(np.floor(left), CHECKED_AHEAD_M)
    return reach


def _build_sign(roads: RoadMap, box: StopSignBox) -> _Sign:
    lane = roads.lanes[box.lane]
    return _Sign(box, lane.centre.at(box.line_pos_m), lane)


def _find_lane_starts(roads: RoadMap, lane: Lane) -> dict[str, float]:
    """Return the start [m], relative to the start of `lane`, of it and the lanes shortly before it: 0 or negative."""
    starts, queue = {lane.id: 0.0}, [lane]
    while queue:
        here = queue.pop(0)
        if starts[here.id] > -CHECKED_AHEAD_M:
            for before in roads.driving:
                if here.id in before.successors and before.id not in starts:
                    starts[before.id] = starts[here.id] - before.centre.length
                    queue.append(before)
    return starts


STOP_SIGNS = InfractionMetric("stop_signs", find_stop_sign_infractions)
