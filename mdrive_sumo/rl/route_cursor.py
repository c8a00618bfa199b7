"""RouteCursor: where a CAV is on its route, by its own estimate."""

from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Briefing, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import EgoState

SEARCH_BACK, SEARCH_AHEAD = 3, 12
"""Route points, one a metre, among which the nearest one is searched: a tick at 60 m/s passes three, and a decision
twelve."""


class RoutePlace(NamedTuple):
    """A place relative to the route."""

    s: float
    """Arc length along the route [m]."""
    offset: float
    """Distance to the left of the route [m]."""
    heading_error: float
    """Heading relative to that of the assigned lane, its sine."""


class RouteCursor:
    """Follows a CAV along its route."""

    def __init__(self, briefing: Briefing) -> None:
        self.s, self.xy = briefing.route_s, briefing.route_xy
        cos, sin = portable.cos_sin(briefing.route_yaw)
        self._normals = np.stack((-sin, cos), axis=-1)
        self._points = list(zip(*(column.tolist() for column in (*self.xy.T, cos, sin, self.s)), strict=True))
        self.index = 0
        """Of the nearest route point in the latest call of `locate`."""

    def locate(self, own: OwnState | EgoState) -> RoutePlace:
        """Return the place of a CAV; the search begins at that of the call before."""
        x, y, points = own.x, own.y, self._points
        first = max(self.index - SEARCH_BACK, 0)
        near = points[first : self.index + SEARCH_AHEAD + 1]
        squares = [(x - px) * (x - px) + (y - py) * (y - py) for px, py, _, _, _ in near]
        self.index = first + squares.index(min(squares))
        px, py, cos, sin, s = points[self.index]
        dx, dy = x - px, y - py
        own_cos, own_sin = portable.cos_sin(own.yaw)
        return RoutePlace(s + dx * cos + dy * sin, dy * cos - dx * sin, own_sin * cos - own_cos * sin)

    def find_points(self, s: Float, offset: Float | float = 0.0) -> Float:
        """Return the points (N, 2) [m] at arc lengths s (N,) that lie `offset` [m] to the left of the route.

        Beyond the end of the route its last lane goes straight on.
        """
        row = np.clip(s.astype(np.intp), 0, len(self.s) - 1)  # points are a metre apart
        along = s - self.s[row]
        normal = self._normals[row]
        ahead = np.stack((normal[:, 1], -normal[:, 0]), axis=-1)
        return self.xy[row] + ahead * along[:, None] + normal * np.broadcast_to(offset, s.shape)[:, None]
