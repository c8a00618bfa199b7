"""ObservationVector: one CAV's observation as numbers of about -1 to 1, in the CAV's own frame.

The parts, in this order: the car itself (9), the route ahead (`ROUTE_AHEAD_M`, 3 each), the next light, stop sign and
junction (8), the nearest road users (11 each), the messages of other CAVs (`message_slots`).
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState, Privileged, SensorSpec
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core import portable
from mdrive_sumo.core.state import Kind
from mdrive_sumo.rl.message_slots import MessageSlots, count_message_numbers
from mdrive_sumo.rl.route_cursor import RouteCursor, RoutePlace

DISTANCE_M = 50.0
"""Scale of distances: a car at 60 km/h stops within it."""
SPEED = 2.0 * PROTOCOL_SPEED
"""Scale of speeds [m/s]."""
ROUTE_AHEAD_M = np.array((5.0, 10.0, 20.0, 30.0, 50.0))
"""Distances along the route of the points in an observation."""
FARTHEST = 4.0
"""Numbers are clipped to this size: nothing beyond 200 m or 64 m/s makes a difference."""
OWN_NUMBERS = 9
ROUTE_NUMBERS = 3 * len(ROUTE_AHEAD_M)
RULE_NUMBERS = 8
OBJECT_NUMBERS = 11
SENSOR_BY_VIEW: Mapping[str, SensorSpec] = {
    "own": SensorSpec("objects", range_m=100.0),
    "privileged": SensorSpec("privileged"),
}
"""The sensor that an observation reads."""
GIVES_WAY = frozenset(("yield", "stop", "all-way-stop", "right-before-left", "left-before-right", "roundabout"))
"""Kinds of junctions at which the CAV may have to give way, without a light."""


def count_numbers(nearest: int, senders: int, message_bytes: int) -> int:
    """Return how many numbers an observation has."""
    fixed = OWN_NUMBERS + ROUTE_NUMBERS + RULE_NUMBERS
    return fixed + OBJECT_NUMBERS * nearest + count_message_numbers(senders, message_bytes)


class _RoadUser(NamedTuple):
    """The columns of the nearest road users, each (N,)."""

    x: npt.NDArray[np.float64]
    y: npt.NDArray[np.float64]
    yaw: npt.NDArray[np.float64]
    speed: npt.NDArray[np.float64]
    length: npt.NDArray[np.float64]
    width: npt.NDArray[np.float64]
    kind: npt.NDArray[np.float64]


class ObservationVector:
    """Writes the observations of one CAV."""

    def __init__(self, briefing: Briefing, cursor: RouteCursor, heard: MessageSlots, nearest: int) -> None:
        self._briefing, self._cursor, self._heard, self._nearest = briefing, cursor, heard, nearest
        self._limits = briefing.route_speed_limit

    def write(self, seen: Observation, out: npt.NDArray[np.float32]) -> None:
        """Write the numbers of an observation into `out` (`count_numbers`,)."""
        own, place = seen.own, self._cursor.locate(seen.own)
        cos, sin = portable.cos_sin(own.yaw)
        first = self._describe_own(seen, place) + self._describe_rules(seen, place)
        out[: len(first)] = first
        end = len(first) + ROUTE_NUMBERS
        out[len(first) : end] = self._describe_route(own, place, cos, sin)
        out[end : end + OBJECT_NUMBERS * self._nearest] = 0.0
        if self._nearest:
            users = self._find_road_users(seen)
            rows = out[end : end + OBJECT_NUMBERS * self._nearest].reshape(self._nearest, OBJECT_NUMBERS)
            _describe_road_users(users, own, cos, sin, rows)
        np.clip(out, -FARTHEST, FARTHEST, out=out)
        self._heard.write(seen.tick, out[end + OBJECT_NUMBERS * self._nearest :])

    def _describe_own(self, seen: Observation, place: RoutePlace) -> list[float]:
        own, briefing = seen.own, self._briefing
        length = float(briefing.route_s[-1])
        return [
            own.speed / SPEED,
            own.acceleration / 5.0,  # m/s2: a firm stop
            own.yaw_rate,
            own.steer_angle / briefing.vehicle.max_steer_angle,
            place.offset / 3.5,  # m: a lane
            place.heading_error,
            (length - place.s) / DISTANCE_M / FARTHEST,
            1.0 - seen.tick * briefing.tick_s / briefing.time_limit_s,
            float(self._limits[min(int(max(place.s, 0.0)), len(self._limits) - 1)]) / SPEED,
        ]

    def _describe_rules(self, seen: Observation, place: RoutePlace) -> list[float]:
        """Return distance and colours of the next light, distance of the next stop sign, and of the next junction."""
        briefing, s = self._briefing, place.s
        light = next((one for one in briefing.traffic_lights if one.s > s), None)
        letter = seen.signals[light.id] if light is not None else ""
        sign = next((one.s for one in briefing.stop_signs if one.s > s), math.inf)
        junction = next((one for one in briefing.junctions if one.exit_s > s), None)
        return [
            _scale_distance(light.s - s if light is not None else math.inf),
            float(letter in "ruR" and letter != ""),
            float(letter in "yY" and letter != ""),
            float(letter in "gG" and letter != ""),
            _scale_distance(sign - s),
            _scale_distance(junction.entry_s - s if junction is not None else math.inf),
            _scale_distance(junction.exit_s - s if junction is not None else math.inf),
            float(junction is not None and junction.kind in GIVES_WAY),
        ]

    def _describe_route(self, own: OwnState, place: RoutePlace, cos: float, sin: float) -> npt.NDArray[np.float64]:
        """Return ahead, left and speed limit of the points at `ROUTE_AHEAD_M`."""
        s = place.s + ROUTE_AHEAD_M
        points = self._cursor.find_points(np.minimum(s, self._cursor.s[-1])) - (own.x, own.y)
        numbers = np.empty((len(s), 3))
        numbers[:, 0] = (points[:, 0] * cos + points[:, 1] * sin) / DISTANCE_M
        numbers[:, 1] = (points[:, 1] * cos - points[:, 0] * sin) / DISTANCE_M
        numbers[:, 2] = self._limits[np.clip(s.astype(np.intp), 0, len(self._limits) - 1)] / SPEED
        return numbers.reshape(-1)

    def _find_road_users(self, seen: Observation) -> _RoadUser:
        if seen.privileged is not None:
            return self._find_all(seen.own, seen.privileged)
        objects = seen.objects
        assert objects is not None, "the view `own` declares the objects sensor"
        n = self._nearest
        columns = (objects.x, objects.y, objects.yaw, objects.speed, objects.length, objects.width, objects.kind)
        return _RoadUser(*(column[:n] for column in columns))

    def _find_all(self, own: OwnState, privileged: Privileged) -> _RoadUser:
        """Return the nearest of all CAVs but the own one, and of everything else."""
        states = [s for name, s in zip(privileged.ego_ids, privileged.states, strict=True) if name != self._briefing.ego_id]
        around: Objects = privileged.objects
        size, cavs = self._briefing.vehicle, np.array([(s.x, s.y, s.yaw, s.speed) for s in states]).reshape(-1, 4)
        sizes = np.full(len(cavs), size.length), np.full(len(cavs), size.width), np.full(len(cavs), int(Kind.VEHICLE))
        others = (around.x, around.y, around.yaw, around.speed, around.length, around.width, around.kind)
        columns = [np.concatenate(pair) for pair in zip((*cavs.T, *sizes), others, strict=True)]
        dx, dy = columns[0] - own.x, columns[1] - own.y
        order = np.argsort(dx * dx + dy * dy, kind="stable")[: self._nearest]
        return _RoadUser(*(column[order] for column in columns))


def _describe_road_users(
    users: _RoadUser, own: OwnState, cos: float, sin: float, rows: npt.NDArray[np.float32]
) -> None:
    """Write a row per road user: present, ahead, left, heading (cos, sin), velocity, length, width, kind (2)."""
    rows = rows[: len(users.x)]
    dx, dy = users.x - own.x, users.y - own.y
    their_cos, their_sin = portable.cos_sin(users.yaw - own.yaw)
    rows[:, 0] = 1.0
    rows[:, 1] = (dx * cos + dy * sin) / DISTANCE_M
    rows[:, 2] = (dy * cos - dx * sin) / DISTANCE_M
    rows[:, 3] = their_cos
    rows[:, 4] = their_sin
    rows[:, 5] = (users.speed * their_cos - own.speed) / SPEED
    rows[:, 6] = users.speed * their_sin / SPEED
    rows[:, 7] = users.length / 10.0  # m: a lorry
    rows[:, 8] = users.width / 2.5  # m: as wide as a vehicle may be
    rows[:, 9] = users.kind == int(Kind.VEHICLE)
    rows[:, 10] = users.kind == int(Kind.STATIC)


def _scale_distance(distance_m: float) -> float:
    """Return a distance ahead on the scale of `DISTANCE_M`; the farthest if there is nothing."""
    return min(distance_m / DISTANCE_M, FARTHEST)
