"""What of a world is taken at the start: boxes, and stretches of lanes that stay free of driving vehicles.

Boxes are arrays and not shapes as in `placement.occupancy`: with hundreds of road users a drawing has to take less than
50 ms."""

from collections.abc import Iterable, Sequence

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline, box_corners, boxes_corners, boxes_overlap
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion
from mdrive_sumo.vehicle import dynamics

CAR = dynamics.MKZ_2017
CLEAR_M, CLEAR_S = 7.0, 1.0
"""[m], [s] No vehicle starts within this distance of the ends of a CAV's box, and this time of its speed beyond."""
ACTOR_CLEAR_M = 2.0
"""[m] Free length before and behind a scripted actor; SUMO's least gap to it is 2.5 m."""
_FIRST_CAPACITY = 64
"""Boxes that there is room for at first; doubled when full."""


class TakenGround:
    """The boxes of everything that is placed, and the stretches of lanes that stay free."""

    def __init__(self, egos: Sequence[Ego], actors: Iterable[Actor]) -> None:
        self._corners: Float = np.zeros((_FIRST_CAPACITY, 4, 2))
        self._bounds: Float = np.zeros((_FIRST_CAPACITY, 4))
        self._count = 0
        self._stretches: dict[str, list[tuple[float, float]]] = {}
        for ego in egos:
            room = 2 * (CLEAR_M + CLEAR_S * ego.start_speed)
            self.take(box_corners(ego.start.x, ego.start.y, ego.start.yaw, CAR.length + room, CAR.width + 0.4))
        for actor in actors:
            room = 2 * (ACTOR_CLEAR_M + CLEAR_S * find_start_speed(actor))
            pose = actor.start
            self.take(box_corners(pose.x, pose.y, pose.yaw, actor.length + room, actor.width + 0.2))

    def take(self, corners: Float) -> None:
        """Take a box, corners (4, 2) [m]."""
        if self._count == len(self._corners):
            self._corners = np.concatenate((self._corners, np.zeros_like(self._corners)))
            self._bounds = np.concatenate((self._bounds, np.zeros_like(self._bounds)))
        self._corners[self._count] = corners
        self._bounds[self._count] = *corners.min(axis=0), *corners.max(axis=0)
        self._count += 1

    def is_free(self, corners: Float) -> bool:
        """Return whether a box, corners (4, 2) [m], overlaps nothing that is taken."""
        bounds = self._bounds[: self._count]
        low, high = corners.min(axis=0), corners.max(axis=0)
        near = np.flatnonzero(((bounds[:, :2] <= high) & (bounds[:, 2:] >= low)).all(axis=1))
        return not len(near) or not boxes_overlap(self._corners[near], corners[None]).any()

    def keep_free(self, stretches: Iterable[tuple[str, float, float]]) -> None:
        """Let no driving vehicle start on stretches (lane, from, to) [m]."""
        for lane, start, end in stretches:
            self._stretches.setdefault(lane, []).append((start, end))

    def is_kept_free(self, lane: str, rear: float, front: float) -> bool:
        """Return whether a vehicle between two stations [m] of a lane would be on a stretch that stays free."""
        return any(rear <= end and front >= start for start, end in self._stretches.get(lane, ()))


def find_start_speed(actor: Actor) -> float:
    """Return the speed [m/s] of an actor at the start."""
    return actor.motion.start_speed if isinstance(actor.motion, LaneMotion | PathMotion) else 0.0


def build_lane_box(roads: RoadMap, lane: str, front: float, size: tuple[float, float]) -> Float:
    """Return the corners (4, 2) [m] of a vehicle whose front is at a station [m] of a lane, on the chord it drives."""
    return build_box_on(roads.lanes[lane].centre, front, size)


def build_box_on(centre: Polyline, front: float, size: tuple[float, float]) -> Float:
    """Return the same for any line."""
    length, width = size
    (x1, y1), (x0, y0) = centre.at(front), centre.at(front - length)
    yaw = centre.yaw_at(min(max(front - length / 2, 0.0), centre.length))
    return boxes_corners(
        np.array((x0 + x1) / 2), np.array((y0 + y1) / 2), np.array(yaw), np.array(length), np.array(width)
    )
