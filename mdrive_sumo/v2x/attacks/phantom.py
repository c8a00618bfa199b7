"""Phantoms: cars that are not there, on the routes of receivers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.state import Kind
from mdrive_sumo.v2x.attacks.route_point import Receiver, RouteFollower, RoutePoint, measure_square
from mdrive_sumo.v2x.content import MAX_OBJECTS, Cpm, ReferencePose, format_track_name

SIZE_M = (4.9, 1.9)
"""Length and width of a phantom: about those of the benchmark's car."""
REACH_M = 150.0
"""[m] Receivers further away get no phantom: an object must lie within a message's reach of its sender (327 m)."""
FIRST_TRACK = 0xF0000000
"""Track numbers of phantoms begin here: real ones are hashes, which hardly ever meet them."""
SIGMAS = (0.15, 0.02, 0.5)
"""Stated standard deviations [m, rad, m/s]: those of a near car by the detector profiles (docs/detections.md)."""


class PhantomMaker:
    """Keeps a phantom before every receiver until it has passed the place, then makes another one."""

    def __init__(self) -> None:
        self._follower = RouteFollower()
        self._place_by_name: dict[str, tuple[int, RoutePoint]] = {}
        """By receiver: number of its phantom, and its place."""
        self._count = 0

    def update(self, receivers: Sequence[Receiver]) -> None:
        """Place phantoms for the receivers of a tick."""
        for receiver in receivers:
            row, place = self._follower.find_row(receiver), self._place_by_name.get(receiver.name)
            if place is None or row > place[1].row:
                self._place(receiver)

    def _place(self, receiver: Receiver) -> None:
        self._place_by_name.pop(receiver.name, None)
        row = self._follower.find_braking_row(receiver)
        if row is not None:
            (x, y), (next_x, next_y) = receiver.route[row].tolist(), receiver.route[row + 1].tolist()
            self._place_by_name[receiver.name] = (
                self._count,
                RoutePoint(row, x, y, portable.atan2(next_y - y, next_x - x)),
            )
            self._count += 1

    def add_to(self, cpm: Cpm, receivers: Sequence[Receiver]) -> Cpm:
        """Return the CPM with the phantoms of the receivers in its reach; the furthest objects make room for them."""
        places = self._select_places(cpm.pose, receivers)
        if not places:
            return cpm
        phantoms, kept = _build_objects(places), slice(MAX_OBJECTS - len(places))
        ages, sigmas = np.zeros(len(places), dtype=np.uint8), np.repeat(np.array([SIGMAS]), len(places), axis=0)
        has_sigmas = len(cpm.sigmas) == len(cpm.objects)
        return replace(
            cpm,
            objects=cpm.objects.take(kept).concat(phantoms),
            age=np.concatenate((cpm.age[kept], ages)),
            sigmas=np.concatenate((cpm.sigmas[kept], sigmas)) if has_sigmas else cpm.sigmas,
        )

    def _select_places(self, pose: ReferencePose, receivers: Sequence[Receiver]) -> Mapping[int, RoutePoint]:
        near = [one for one in receivers if measure_square(one, pose.x, pose.y) < REACH_M * REACH_M]
        places = [self._place_by_name[one.name] for one in near if one.name in self._place_by_name]
        return dict(places[:MAX_OBJECTS])


def _build_objects(places: Mapping[int, RoutePoint]) -> Objects:
    columns = np.array([(place.x, place.y, place.yaw, 0.0, *SIZE_M) for place in places.values()])
    ids = tuple(format_track_name(FIRST_TRACK + number) for number in places)
    return Objects(ids, np.full(len(ids), Kind.VEHICLE, dtype=np.uint8), *columns.T)
