"""Loss round the corner of a crossing between houses, for the corner model VirtualSource11p (`v2x.radio.path_loss`)."""

import math
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.building_edges import BuildingEdges
from mdrive_sumo.v2x.radio.path_loss import LEAST_DISTANCE_M, compute_corner_loss

CELL_M = 1.0
"""Places are rounded to this grid: what is seen from a cell is computed once."""
CROSSING_REACH_M = 250.0
"""Farthest crossing that is considered: the measurements of the model end before."""
STREET_SIDE_M = 50.0
"""A side of the street without a house within this distance counts as this wide: wider than any street measured."""


class _Approach(NamedTuple):
    """A crossing as a station sees it."""

    distance_m: float
    """To its middle."""
    nearest_wall_m: float
    """To the houses on the nearer side of the street."""
    street_m: float
    """Width of the street between the houses."""


class StreetCorners:
    """The crossings of a map, and which of them two stations see between them."""

    def __init__(self, roads: RoadMap, edges: BuildingEdges) -> None:
        middles = [(outline.min(axis=0) + outline.max(axis=0)) / 2 for outline in roads.junctions if len(outline)]
        self._middles: Float = np.array(middles).reshape(-1, 2)
        self._walls = edges.walls
        self._approaches: dict[tuple[int, int], dict[int, _Approach]] = {}

    def compute_loss(self, first: tuple[float, float], second: tuple[float, float], height_m: float) -> float:
        """Return the median loss [dB] between two places [m] round the corner of the crossing with the shortest way.

        The mean of both directions: the model has distance and street width of sender and receiver in different places.
        NaN if they see no crossing in common. height_m: of both antennas.
        """
        ways = self._find_approaches(first), self._find_approaches(second)
        common = [(ways[0][k].distance_m + ways[1][k].distance_m, k) for k in ways[0] if k in ways[1]]
        if not common:
            return math.nan
        one, other = (way[min(common)[1]] for way in ways)
        losses = [
            compute_corner_loss(
                tx.distance_m, rx.distance_m, rx.street_m, tx.nearest_wall_m, height_m=height_m, suburban=False
            )
            for tx, rx in ((one, other), (other, one))
        ]
        return (losses[0] + losses[1]) / 2

    def _find_approaches(self, place: tuple[float, float]) -> dict[int, _Approach]:
        """Return the crossings that are seen from a place, by their index."""
        cell = round(place[0] / CELL_M), round(place[1] / CELL_M)
        if cell not in self._approaches:
            self._approaches[cell] = self._look_around(cell[0] * CELL_M, cell[1] * CELL_M)
        return self._approaches[cell]

    def _look_around(self, x: float, y: float) -> dict[int, _Approach]:
        seen: dict[int, _Approach] = {}
        for k, (to_x, to_y) in enumerate(self._middles.tolist()):
            distance = portable.hypot(to_x - x, to_y - y)
            if distance > CROSSING_REACH_M or self._measure_free(x, y, to_x - x, to_y - y, 1.0) < 1.0:
                continue
            distance = max(distance, LEAST_DISTANCE_M)
            ahead_x, ahead_y = (to_x - x) / distance, (to_y - y) / distance
            left = self._measure_free(x, y, -ahead_y, ahead_x, STREET_SIDE_M)
            right = self._measure_free(x, y, ahead_y, -ahead_x, STREET_SIDE_M)
            nearest = max(min(left, right), LEAST_DISTANCE_M)
            seen[k] = _Approach(distance, nearest, max(left + right, nearest))
        return seen

    def _measure_free(self, x: float, y: float, dx: float, dy: float, most: float) -> float:
        """Return how many times (dx, dy) a ray from (x, y) goes before it meets a wall, at most `most`."""
        walls = self._walls
        ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
        px, py = walls[:, 0] - x, walls[:, 1] - y
        turn = dx * ey - dy * ex
        meets = turn != 0.0
        divisor = np.where(meets, turn, 1.0)
        along, across = (px * ey - py * ex) / divisor, (px * dy - py * dx) / divisor
        hit = meets & (along > 0.0) & (across >= 0.0) & (across <= 1.0)
        return min(float(np.min(along[hit], initial=most)), most)
