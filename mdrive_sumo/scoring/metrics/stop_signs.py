"""Passing a stop sign without stopping (protocol 7.7)."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.roads.road_map import RoadMap
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent, TrackPiece
from mdrive_sumo.scoring.metrics.metric import InfractionMetric

SIGN_RANGE_M = 50.0
"""Signs further away than this [m] are ignored."""
CHECKED_AHEAD_M = 20
"""The original checks the centre and 20 lane points ahead of it, 1 m apart."""
STOPPED_SPEED = 0.1
"""[m/s]"""
PENALTY_FACTOR = 0.80
"""Protocol 7.1."""


def find_stop_sign_infractions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the stop signs whose box the CAV passed without standing (below 0.1 m/s).

    One sign at a time is active, from the tick after it comes into reach until it is out of reach; the infraction
    depends on whether the centre was in the box and whether the CAV stood in between. A sign less than 50 m away is in
    reach if the centre, or one of 20 points ahead of it along its nearest lane and any successors, is in the box. A CAV
    that faces against its lane (over 90 degrees) activates no sign: the original has this guard, because cutting a
    corner through an oncoming lane's box would count otherwise. A network whose signs are unknown yields none.
    """
    watch = StopSignWatch(track.roads)
    return tuple(track.make_infraction("stop-sign", tick, sign, PENALTY_FACTOR) for tick, sign in watch.add(track))


class PassedStopSign(NamedTuple):
    """A stop sign that was passed without standing, in the tick in which it is out of reach."""

    tick: int
    sign: str


class _Sign:
    """A stop sign of a map, with its line and lane."""

    def __init__(self, roads: RoadMap, box: StopSignBox) -> None:
        self.box = box
        self.lane = roads.lanes[box.lane]
        self.line = self.lane.centre.at(box.line_pos_m)
        """Middle of the stop line [m]."""
        self._roads = roads

    @cached_property
    def start_by_lane(self) -> dict[str, float]:
        """Start [m], relative to the start of `lane`, of it and the lanes shortly before it: 0 or negative."""
        starts, queue = {self.lane.id: 0.0}, [self.lane]
        while queue:
            here = queue.pop(0)
            if starts[here.id] > -CHECKED_AHEAD_M:
                for before in self._roads.driving:
                    if here.id in before.successors and before.id not in starts:
                        starts[before.id] = starts[here.id] - before.centre.length
                        queue.append(before)
        return starts


class StopSignWatch:
    """The stop signs that one CAV passes, in whole tracks or piece by piece as it drives, with the same result."""

    def __init__(self, roads: RoadMap) -> None:
        self._signs = [_Sign(roads, box) for box in roads.stop_signs or ()]
        self._ticks = 0
        self._target: _Sign | None = None
        """The active sign, and whether the CAV was in its box, or stood, since it became active."""
        self._has_entered = False
        self._has_stood = False

    def add(self, piece: EgoTrack | TrackPiece) -> list[PassedStopSign]:
        """Take the next ticks, and return the signs that were passed in them without standing."""
        first_tick, count = self._ticks, len(piece.xy)
        self._ticks += count
        in_range = {sign: _compute_distances(piece, sign.line) < SIGN_RANGE_M for sign in self._signs}
        near = [sign for sign, is_near in in_range.items() if is_near.any() or sign is self._target]
        if not near:
            return []
        inside = {sign: _is_inside(piece, sign) for sign in near}
        reach = {sign: (_is_in_reach(piece, sign) | inside[sign]) & in_range[sign] for sign in near}
        facing = np.abs(wrap_angles(piece.yaw - piece.nearest.yaw)) < np.pi / 2
        passed: list[PassedStopSign] = []
        for row in range(count):  # the original's state machine
            target = self._target
            if target is None:
                if facing[row]:
                    self._target = next((sign for sign in near if reach[sign][row]), None)
                    self._has_entered = self._has_stood = False
                continue
            self._has_stood = self._has_stood or abs(float(piece.speed[row])) < STOPPED_SPEED
            self._has_entered = self._has_entered or bool(inside[target][row])
            if not reach[target][row]:
                if self._has_entered and not self._has_stood:
                    passed.append(PassedStopSign(first_tick + row, target.box.id))
                self._target = None
        return passed


def _compute_distances(piece: EgoTrack | TrackPiece, point: tuple[float, float]) -> Float:
    return portable.hypot(piece.xy[:, 0] - point[0], piece.xy[:, 1] - point[1])


def _is_inside(piece: EgoTrack | TrackPiece, sign: _Sign) -> Bool:
    """Return an (n,) mask: the centre is in the sign's box, a rectangle along the lane at its line."""
    yaw = sign.lane.centre.yaw_at(sign.box.line_pos_m)
    dx, dy = (piece.xy - sign.line).T
    cos, sin = portable.cos_sin(yaw)
    back, side = -(dx * cos + dy * sin), np.abs(dy * cos - dx * sin)
    return (back >= 0.0) & (back <= sign.box.length_m) & (side <= sign.lane.width / 2)


def _is_in_reach(piece: EgoTrack | TrackPiece, sign: _Sign) -> Bool:
    """Return an (n,) mask: one of the points 1, 2 ... 20 m ahead along the lanes lies in the box."""
    reach = np.zeros(len(piece.xy), dtype=np.bool_)
    for index in np.unique(piece.nearest.lane):
        lane = piece.roads.driving[index]
        if lane.id in sign.start_by_lane:
            on = np.flatnonzero(piece.nearest.lane == index)
            line = shapely.LineString(lane.centre.xy)
            station = sign.start_by_lane[lane.id] + shapely.line_locate_point(line, shapely.points(piece.xy[on]))
            left = sign.box.line_pos_m - station
            first = np.maximum(np.ceil(left - sign.box.length_m), 1.0)
            reach[on] = first <= np.minimum(np.floor(left), CHECKED_AHEAD_M)
    return reach


STOP_SIGNS = InfractionMetric("stop_signs", find_stop_sign_infractions)
