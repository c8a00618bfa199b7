"""The point on a receiver's route at which something makes it brake."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import Float

REACTION_S = 1.0
"""[s] Chosen: messages arrive and a plan changes within half a second; the rest is the first half of a stop."""
BRAKING = 3.0
"""[m/s2] Deceleration that brings a receiver to a stand before the point: firm, but no emergency."""
GAP_M = 7.0
"""[m] Half of two cars and 2 m between them."""
SEARCH_POINTS = 80
"""Route points (1 m each) after the last one within which a receiver is sought: it drives 2 m a tick at most."""


@dataclass(frozen=True, slots=True)
class Receiver:
    """A CAV that receives an attacker's messages, as the attacker knows it: exactly."""

    name: str
    """Its station id in messages."""
    x: float
    y: float
    speed: float
    """[m/s]"""
    route: Float
    """(N, 2) points [m] of its route, 1 m apart."""


class RoutePoint(NamedTuple):
    """A point of a route."""

    row: int
    x: float
    y: float
    yaw: float
    """Direction of the route [rad]."""


class RouteFollower:
    """Finds where receivers are on their routes, also where a route crosses itself."""

    def __init__(self) -> None:
        self._row_by_name: dict[str, int] = {}

    def find_row(self, receiver: Receiver) -> int:
        """Return the index of the nearest route point."""
        begin = self._row_by_name.get(receiver.name, 0)
        ahead = receiver.route[begin : begin + SEARCH_POINTS]
        dx, dy = ahead[:, 0] - receiver.x, ahead[:, 1] - receiver.y
        row = begin + int(np.argmin(dx * dx + dy * dy))
        self._row_by_name[receiver.name] = row
        return row

    def find_braking_row(self, receiver: Receiver) -> int | None:
        """Return the index of the point before which a receiver has to brake now; None behind the end of its route."""
        speed = receiver.speed
        row = self.find_row(receiver) + round(GAP_M + speed * REACTION_S + speed * speed / (2 * BRAKING))
        return row if row < len(receiver.route) - 1 else None


def measure_square(receiver: Receiver, x: float, y: float) -> float:
    """Return the square of the distance [m2] of a receiver from a point."""
    dx, dy = receiver.x - x, receiver.y - y
    return dx * dx + dy * dy
