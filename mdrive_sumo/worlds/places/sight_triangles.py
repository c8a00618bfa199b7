"""Sight triangles at junctions without signals, which nothing may block.

A driver who waits with the eyes 3 m from the edge of the other road sees vehicles with priority at the distance of
RASt 06, table 59 (FGSV, guidelines for urban roads, page 125), outside of towns RAL (page 109: 200 m at 100 km/h).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.worlds.places.street_lines import cut_line, measure_line, offset_line

EYE_M = 3.0
"""[m] From the edge of the road with priority to the eyes of a driver who waits (RASt 06, 6.3.9.3)."""
LEG_M = ((30.0, 30.0), (40.0, 50.0), (50.0, 70.0), (60.0, 85.0), (70.0, 110.0), (100.0, 200.0))
"""Speed limit [km/h] and length of the triangle along the road [m]; between them linear."""
MARGIN_M = 1.0
"""Beside the lines of sight."""
LEAST_SINE = 0.5
"""Roads that meet at less than 30 degrees are no crossing."""


@dataclass(frozen=True, eq=False)
class Approach:
    """A street that leads to a junction."""

    line: Float
    """Points (N, 2) [m] from the junction's centre outwards."""
    lanes: tuple[int, int]
    """Lanes into the junction and out of it."""
    lane_m: float
    speed: float
    has_priority: bool
    """Whether another approach of the junction gives way to it."""
    gives_way: bool

    @property
    def half_m(self) -> float:
        """Half of the width of the road [m], without pavements."""
        return max(self.lanes) * self.lane_m


def compute_leg(speed: float) -> float:
    """Return the length [m] along a road with a speed limit [m/s] within which a waiting driver sees vehicles."""
    limits, legs = zip(*LEG_M, strict=True)
    return float(np.interp(speed * 3.6, limits, legs))


def build_sight_triangles(approaches: Sequence[Approach]) -> list[BaseGeometry]:
    """Return the areas [m] to keep free: from each approach that gives way to each other one that has priority."""
    areas: list[BaseGeometry] = []
    for waiting in (a for a in approaches if a.gives_way):
        others = [a for a in approaches if a is not waiting and a.has_priority]
        for other in others:
            square_m = other.half_m + EYE_M + waiting.lane_m / 2
            eye_m = min(square_m / max(_compute_sine(waiting.line, other.line), LEAST_SINE), measure_line(waiting.line))
            eye = _find_point(offset_line(waiting.line, waiting.lanes[0] * waiting.lane_m / 2), eye_m)
            leg_m = min(compute_leg(other.speed) + MARGIN_M, measure_line(other.line))
            seen = cut_line(other.line, 0.0, measure_line(other.line) - leg_m)
            seen = offset_line(seen, other.lanes[0] * other.lane_m / 2)
            parts = [shapely.Polygon((eye, a, b)) for a, b in pairwise((waiting.line[0], *seen))]
            areas.append(shapely.union_all([part.buffer(MARGIN_M, quad_segs=2) for part in parts]))
    return areas


def _compute_sine(line: Float, other: Float) -> float:
    """Return the sine of the angle between the first steps of two lines; 1 for an angle that is not acute."""
    a, b = line[1] - line[0], other[1] - other[0]
    lengths = float(np.sqrt((a * a).sum() * (b * b).sum()))
    is_acute = float(a[0] * b[0] + a[1] * b[1]) > 0.0
    return abs(float(a[0] * b[1] - a[1] * b[0])) / lengths if is_acute else 1.0


def _find_point(line: Float, station_m: float) -> Float:
    """Return the point [m] at a station of a line."""
    return shapely.get_coordinates(shapely.LineString(line).interpolate(station_m))[0]
