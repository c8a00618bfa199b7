"""ObservationVector: one CAV's observation as numbers of about -1 to 1, in the CAV's own frame.

The parts, in this order: the car itself (9), the route ahead (3 for each of `ROUTE_AHEAD_M`), the next light, stop sign
and junction (8), the nearest road users (11 each), the messages of other CAVs (`message_slots`).
"""

import math

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Briefing, Observation, OwnState
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core import portable
from mdrive_sumo.core.state import EgoState, Kind, RoadUsers
from mdrive_sumo.rl.message_slots import MessageSlots, count_message_numbers
from mdrive_sumo.rl.route_cursor import RouteCursor, RoutePlace

DISTANCE_M = 50.0
"""Scale of distances: a car at 60 km/h stops within it."""
SPEED = 2.0 * PROTOCOL_SPEED
"""Scale of speeds [m/s]."""
ROUTE_AHEAD_M = (5, 10, 20, 30, 50)
"""Distances along the route of the points in an observation."""
FARTHEST = 4.0
"""Numbers are clipped to this size: nothing beyond 200 m or 64 m/s makes a difference."""
LANE_M = 3.5
"""Scale of offsets from the route."""
USER_LENGTH_M, USER_WIDTH_M = 10.0, 2.5
"""Scales of sizes: a lorry, and as wide as a vehicle may be."""
OWN_COLUMNS = (
    *("speed", "acceleration", "yaw rate", "steering", "offset left", "heading error"),
    *("route left", "time left", "speed limit"),
)
ROUTE_COLUMNS = ("ahead", "left", "speed limit")
RULE_COLUMNS = (
    *("light", "is red", "is yellow", "is green", "stop sign", "junction begins", "junction ends", "may give way"),
)
OBJECT_COLUMNS = (
    *("is there", "ahead", "left", "heading cos", "heading sin", "speed ahead", "speed left", "length", "width"),
    *("is vehicle", "is static"),
)
"""What the numbers of each part are."""
OWN_NUMBERS = len(OWN_COLUMNS)
ROUTE_NUMBERS = len(ROUTE_COLUMNS) * len(ROUTE_AHEAD_M)
RULE_NUMBERS = len(RULE_COLUMNS)
OBJECT_NUMBERS = len(OBJECT_COLUMNS)
GIVES_WAY = frozenset(("yield", "stop", "all-way-stop", "right-before-left", "left-before-right", "roundabout"))
"""Kinds of junctions at which the CAV may have to give way, without a light."""


def count_numbers(nearest: int, senders: int, message_bytes: int) -> int:
    """Return how many numbers an observation has."""
    fixed = OWN_NUMBERS + ROUTE_NUMBERS + RULE_NUMBERS
    return fixed + OBJECT_NUMBERS * nearest + count_message_numbers(senders, message_bytes)


class ObservationVector:
    """Writes the observations of one CAV."""

    def __init__(self, briefing: Briefing, cursor: RouteCursor, heard: MessageSlots, nearest: int) -> None:
        self._briefing, self._cursor, self._heard, self._nearest = briefing, cursor, heard, nearest
        self._limits: list[float] = briefing.route_speed_limit.tolist()
        self._route_ahead = _list_route_ahead(briefing)

    def write(
        self, seen: Observation, own: OwnState | EgoState, users: RoadUsers, out: npt.NDArray[np.float32]
    ) -> None:
        """Write the numbers of an observation into `out` (`count_numbers`,).

        own: state of the CAV, as its instruments or the simulator have it; users: the other road users, nearest first.
        """
        place = self._cursor.locate(own)
        cos, sin = portable.cos_sin(own.yaw)
        route = self._describe_route(own, cos, sin)
        first = self._describe_own(seen.tick, own, place) + route + self._describe_rules(seen, place)
        end = len(first)
        out[:end] = first
        out[end : end + OBJECT_NUMBERS * self._nearest] = 0.0
        if self._nearest:
            rows = out[end : end + OBJECT_NUMBERS * self._nearest].reshape(self._nearest, OBJECT_NUMBERS)
            _describe_road_users(users.take(slice(self._nearest)), own, cos, sin, rows)
        np.minimum(out, FARTHEST, out=out)  # half the time of np.clip
        np.maximum(out, -FARTHEST, out=out)
        self._heard.write(seen.tick, out[end + OBJECT_NUMBERS * self._nearest :])

    def _describe_own(self, tick: int, own: OwnState | EgoState, place: RoutePlace) -> list[float]:
        briefing = self._briefing
        length = float(briefing.route_s[-1])
        return [
            own.speed / SPEED,
            own.acceleration / 5.0,  # m/s2: a firm stop
            own.yaw_rate,
            own.steer_angle / briefing.vehicle.max_steer_angle,
            place.offset / LANE_M,
            place.heading_error,
            (length - place.s) / DISTANCE_M / FARTHEST,
            1.0 - tick * briefing.tick_s / briefing.time_limit_s,
            self._limits[self._cursor.index] / SPEED,
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

    def _describe_route(self, own: OwnState | EgoState, cos: float, sin: float) -> list[float]:
        """Return ahead, left and speed limit of the points at `ROUTE_AHEAD_M` from the nearest route point."""
        numbers: list[float] = []
        for x, y, limit in self._route_ahead[self._cursor.index]:
            dx, dy = x - own.x, y - own.y
            numbers += (
                (dx * cos + dy * sin) / DISTANCE_M,
                (dy * cos - dx * sin) / DISTANCE_M,
                limit / SPEED,
            )
        return numbers


def _list_route_ahead(briefing: Briefing) -> list[list[tuple[float, float, float]]]:
    """Return x, y [m] and speed limit [m/s] of the points ahead of each route point; routes have a point a metre."""
    columns = (*briefing.route_xy.T.tolist(), briefing.route_speed_limit.tolist())
    points = list(zip(*columns, strict=True))
    last = len(points) - 1
    return [[points[min(row + ahead, last)] for ahead in ROUTE_AHEAD_M] for row in range(len(points))]


def _describe_road_users(
    users: RoadUsers, own: OwnState | EgoState, cos: float, sin: float, rows: npt.NDArray[np.float32]
) -> None:
    """Write a row per road user: present, ahead, left, heading (cos, sin), velocity, length, width, kind (2)."""
    rows = rows[: len(users)]
    dx, dy = users.x - own.x, users.y - own.y
    their_cos, their_sin = portable.cos_sin(users.yaw - own.yaw)
    rows[:, 0] = 1.0
    rows[:, 1] = (dx * cos + dy * sin) / DISTANCE_M
    rows[:, 2] = (dy * cos - dx * sin) / DISTANCE_M
    rows[:, 3] = their_cos
    rows[:, 4] = their_sin
    rows[:, 5] = (users.speed * their_cos - own.speed) / SPEED
    rows[:, 6] = users.speed * their_sin / SPEED
    rows[:, 7] = users.length / USER_LENGTH_M
    rows[:, 8] = users.width / USER_WIDTH_M
    rows[:, 9] = users.kind == int(Kind.VEHICLE)
    rows[:, 10] = users.kind == int(Kind.STATIC)


def _scale_distance(distance_m: float) -> float:
    """Return a distance ahead on the scale of `DISTANCE_M`; the farthest if there is nothing."""
    return min(distance_m / DISTANCE_M, FARTHEST)
