"""Rows of houses along the streets of a draft: with gaps, at a given distance from the road."""

from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.network_draft import NetworkDraft, Street


@dataclass(frozen=True, slots=True)
class HouseRows:
    """How houses stand along all streets."""

    setback_m: tuple[float, float]
    """Least and largest distance from the edge of lane or pavement."""
    gap_m: tuple[float, float] = (2.0, 14.0)
    """Least and greatest gap [m] between two houses of a row."""
    size_m: tuple[float, float] = (9.0, 24.0)
    """Length along the street."""
    depth_m: tuple[float, float] = (7.0, 13.0)
    share: float = 1.0
    """Share of the places that are built on."""


def measure_half_widths(draft: NetworkDraft, street: Street) -> tuple[float, float]:
    """Return the distance [m] from the line to the edge of the road on its left and on its right."""
    forward, backward = street.lanes
    if street.centred:
        half = max(forward, backward) * draft.lane_m / 2 + street.beside_m
        return half, half
    return (
        (backward * draft.lane_m + street.beside_m) if backward else 0.5,
        (forward * draft.lane_m + street.beside_m) if forward else 0.5,
    )


def build_surface(draft: NetworkDraft, street: Street) -> shapely.Geometry:
    """Return the area of a street with what lies beside its lanes, rounded at its ends."""
    line = shapely.LineString(street.line)
    left, right = measure_half_widths(draft, street)
    sides = [line.buffer(left, single_sided=True), line.buffer(-right, single_sided=True)]
    ends = [shapely.Point(end).buffer(max(left, right)) for end in (street.line[0], street.line[-1])]
    return shapely.union_all([*sides, *ends])


def build_house(line: shapely.LineString, along: tuple[float, float], near: float, far: float) -> Float:
    """Return the rectangle beside the line; the signs of `near` and `far` [m] say on which side (left is positive)."""
    a, b = line.interpolate(along[0]), line.interpolate(along[0] + along[1])
    yaw = portable.atan2(b.y - a.y, b.x - a.x)
    ahead, left = np.array((portable.cos(yaw), portable.sin(yaw))), np.array((-portable.sin(yaw), portable.cos(yaw)))
    begin = np.array((a.x, a.y))
    corners = [begin + near * left, begin + along[1] * ahead + near * left]
    corners += [begin + along[1] * ahead + far * left, begin + far * left]
    return np.array(corners)
