"""Put buildings, hedges, walls and trees along the streets of a draft, by the rules of its surroundings."""

import random
from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Street
from mdrive_sumo.worlds.places.street_houses import HouseRows, build_house, build_surface, measure_half_widths
from mdrive_sumo.worlds.places.surroundings import Surroundings
from mdrive_sumo.worlds.places.waiting_areas import build_waiting_areas

SHORTER = (1.0, 0.75, 0.5)
"""Shares of the length that a building has where the whole of it does not fit."""
STEP_M = 1.5
"""[m] By so much a building that does not fit moves along its street."""
APART_M = 0.4
"""[m] Least distance between two things."""
LEAST_M = 5.0
"""[m] Length of a building that is not shortened any more."""


def add_surroundings(
    draft: NetworkDraft, surroundings: Surroundings, keep_free: Sequence[BaseGeometry], rng: random.Random
) -> None:
    """Add what stands along the streets: nothing on roads, pavements or `keep_free`, nothing on each other."""
    road = shapely.union_all([_build_road(draft), *keep_free])
    taken = _Taken()
    for kind, rows in ((row.kind, row.rows) for row in surroundings.rows):
        apart_m = max(rows.setback_m[0] - 0.1, APART_M) if kind == "house" else APART_M
        blocked = road.buffer(apart_m, quad_segs=4)
        shapely.prepare(blocked)
        for street in draft.streets:
            for side in (1, -1):
                if measure_half_widths(draft, street)[0 if side > 0 else 1] > 1.0:  # the side has lanes
                    _add_row(draft, street, side, (kind, rows), (blocked, taken), rng)


class _Taken:
    """What stands on the land already."""

    def __init__(self) -> None:
        self._shapes: list[BaseGeometry] = []
        self._bounds = np.empty((0, 4))

    def add(self, shape: BaseGeometry) -> None:
        self._shapes.append(shape)
        self._bounds = np.concatenate((self._bounds, [shape.bounds]))

    def is_near(self, shape: BaseGeometry) -> bool:
        """Return whether something stands nearer than `APART_M`."""
        left, low, right, high = shape.bounds
        apart = (self._bounds[:, 0] > right + APART_M) | (self._bounds[:, 2] < left - APART_M)
        apart |= (self._bounds[:, 1] > high + APART_M) | (self._bounds[:, 3] < low - APART_M)
        return any(self._shapes[i].distance(shape) < APART_M for i in np.flatnonzero(~apart))


def _build_road(draft: NetworkDraft) -> BaseGeometry:
    """Return the area of all streets with the rounded corners of junctions, and of car parks."""
    road = shapely.union_all([build_surface(draft, street) for street in draft.streets])
    corner_m = max((node.radius for node in draft.nodes if node.type), default=5.0) + 1.0
    areas = [shapely.Polygon(area).buffer(0.3) for area in draft.paved_areas]
    rounded = shapely.union_all([road, *areas]).buffer(corner_m, quad_segs=4).buffer(-corner_m, quad_segs=4)
    return shapely.union_all([rounded, road, *build_waiting_areas(draft)])


def _add_row(
    draft: NetworkDraft,
    street: Street,
    side: int,
    row: tuple[str, HouseRows],
    land: tuple[BaseGeometry, _Taken],
    rng: random.Random,
) -> None:
    """Add the row on one side of a street.

    land: where nothing may stand, and what stands on the rest.
    """
    kind, rows = row
    is_outward = _begins_at_junction(draft, street)
    line = shapely.LineString(street.line if is_outward else street.line[::-1])
    half = measure_half_widths(draft, street)[0 if side > 0 else 1]
    left = side if is_outward else -side
    station = rng.uniform(0.0, rows.gap_m[1] / 2)
    while station < line.length - 1.0:
        length, depth = rng.uniform(*rows.size_m), rng.uniform(*rows.depth_m)
        near, is_built = half + rng.uniform(*rows.setback_m), rng.random() < rows.share
        last = station + length
        while is_built and station < last:
            outline = _fit_outline(line, (station, length), (left * near, left * (near + depth)), land)
            if outline is not None:
                land[1].add(shapely.Polygon(outline))
                if kind == "house":
                    draft.buildings.append(outline)
                else:
                    draft.obstacles.append((kind, outline))
                break
            station += STEP_M
        station += length + rng.uniform(*rows.gap_m)


def _begins_at_junction(draft: NetworkDraft, street: Street) -> bool:
    """Return whether a row of a street starts at its begin, so that the first house stands at a corner."""
    return any(node.id == street.begin and node.type for node in draft.nodes)


def _fit_outline(
    line: shapely.LineString,
    along: tuple[float, float],
    across: tuple[float, float],
    land: tuple[BaseGeometry, _Taken],
) -> Float | None:
    """Return the outline of the longest part of a building that touches nothing, or None."""
    blocked, taken = land
    station, length = along
    for share in SHORTER:
        part = length * share
        if station + part > line.length or (share < 1.0 and part < LEAST_M):
            continue
        outline = build_house(line, (station, part), *across)
        shape = shapely.Polygon(outline)
        if not blocked.intersects(shape) and not taken.is_near(shape):
            return outline
    return None
