"""Alignments: lines of roads with bends that a guideline allows for their speed limit, and lines beside them."""

import math
import random
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline, wrap_angle

Piece = tuple[float, float]
"""Length [m] and signed radius [m] of an arc: positive turns left, 0 is straight."""
SIDE_FRICTION: Mapping[int, float] = {
    30: 0.28, 40: 0.23, 50: 0.19, 60: 0.17, 70: 0.15, 80: 0.14, 90: 0.13, 100: 0.12, 110: 0.11, 120: 0.09, 130: 0.08,
}  # fmt: skip
"""Largest side friction by design speed [km/h] (AASHTO, A Policy on Geometric Design of Highways and Streets, 2018,
section 3.3.3)."""
SUPERELEVATION = 0.06
"""Largest superelevation of rural roads and motorways (there)."""
URBAN_CROSSFALL = -0.02
"""Streets below 60 km/h have a normal crown: half of the carriageway falls away from the bend (there, 3.3.6)."""
URBAN_KMH = 50
"""[km/h] Up to this limit a road is a street with a normal crown."""
STEP_M = 6.0
"""[m] Distance of points on an arc at most; the chord of a bend of 80 m then lies 6 cm beside it."""
LEAST_STEP_M = 0.5
"""[m] Points lie further apart than that, so that rounding to a decimetre keeps the direction between them."""
NEAR_M = 0.02
"""[m] Just before or behind a point of a line."""


def compute_least_radius(limit_kmh: float) -> float:
    """Return the least radius [m] of a bend at a limit of 30 to 130 km/h: v² / (127 (e + f)), AASHTO (2018) eq. 3-8."""
    speed = min(kmh for kmh in SIDE_FRICTION if kmh >= limit_kmh - 1e-6)
    elevation = URBAN_CROSSFALL if speed <= URBAN_KMH else SUPERELEVATION
    return speed * speed / (127.0 * (elevation + SIDE_FRICTION[speed]))


def draw_bends(
    rng: random.Random, length_m: float, limit_kmh: float, sinuosity: float, turn_deg: tuple[float, float] = (8.0, 40.0)
) -> list[Piece]:
    """Return pieces of a road of about `length_m`: straights and bends by turns, to the left and to the right.

    sinuosity: share of the length that lies in bends, 0 (straight) to 1. turn_deg: range of the angle of a bend; it is
    less where a bend has no room. Radii are 1 to 2.5 times the least one of the limit.
    """
    least, pieces, left, total = compute_least_radius(limit_kmh), list[Piece](), rng.random() < 0.5, 0.0
    if sinuosity <= 0.0:
        return [(length_m, 0.0)]
    while total < length_m - 20.0:
        radius = least * rng.uniform(1.0, 2.5)
        arc = min(radius * math.radians(rng.uniform(*turn_deg)), length_m - total, length_m * sinuosity)
        straight = min(arc * (1.0 / sinuosity - 1.0) * rng.uniform(0.7, 1.3), length_m - total - arc)
        for piece in ((max(straight / 2, 0.0), 0.0), (arc, radius if left else -radius), (max(straight / 2, 0.0), 0.0)):
            if piece[0] > 1.0:
                pieces.append(piece)
                total += piece[0]
        left = not left if rng.random() < 0.8 else left
    return pieces


def trace_axis(start: tuple[float, float], heading: float, pieces: Sequence[Piece]) -> Polyline:
    """Return the line along the pieces, from `start` [m] in direction `heading` [rad]."""
    x, y = start
    points = [start]
    for length, radius in pieces:
        count = max(math.ceil(length / min(STEP_M, abs(radius) / 6)), 1) if radius else 1
        for _ in range(count):
            turn = length / count / radius if radius else 0.0
            chord = 2 * abs(radius) * portable.sin(abs(turn) / 2) if radius else length
            cos, sin = portable.cos_sin(heading + turn / 2)
            x, y = x + chord * cos, y + chord * sin
            heading += turn
            points.append((x, y))
    return build_polyline(points)


def find_point(line: Polyline, station: float, left_m: float = 0.0) -> tuple[float, float]:
    """Return the point `left_m` to the left of the line at a station [m]; outside the line its ends are extended."""
    (x, y), (cos, sin) = line.at(station), portable.cos_sin(compute_heading(line, station))
    return x - left_m * sin, y + left_m * cos


def compute_heading(line: Polyline, station: float) -> float:
    """Return the direction [rad] of the line at a station [m]: at its points, the mean of both segments."""
    before, after = line.yaw_at(station - NEAR_M), line.yaw_at(station + NEAR_M)
    return before + wrap_angle(after - before) / 2


def cut_line(line: Polyline, begin: float, end: float) -> Polyline:
    """Return the part of the line between two stations [m]."""
    inside = [s for s in line.s.tolist() if begin + LEAST_STEP_M < s < end - LEAST_STEP_M]
    return build_polyline([line.at(s) for s in (begin, *inside, end)])


def shift_line(line: Polyline, left_m: float | Callable[[float], float], step_m: float = 0.0) -> Polyline:
    """Return the line `left_m` to the left of a line; a function gives it by station, every `step_m` if that is set."""
    stations = line.s.tolist()
    if step_m:
        steps = np.linspace(0.0, line.length, max(round(line.length / step_m), 1) + 1).tolist()
        stations = steps + [s for s in stations if all(abs(s - step) >= LEAST_STEP_M for step in steps)]
    points = list[tuple[float, float]]()
    for station in sorted(stations):
        offset = left_m(station) if callable(left_m) else left_m
        points.append(find_point(line, station, offset * _compute_mitre(line, station)))
    return build_polyline(points)


def _compute_mitre(line: Polyline, station: float) -> float:
    """Return by how much a point beside a corner lies further away than the segments beside it."""
    turn = wrap_angle(line.yaw_at(station + NEAR_M) - line.yaw_at(station - NEAR_M))
    return 1.0 / portable.cos(turn / 2) if abs(turn) < 1.0 else 1.0


def reverse_line(line: Polyline) -> Polyline:
    """Return the line in the other direction."""
    return Polyline(np.ascontiguousarray(line.xy[::-1]))


def join_lines(*lines: Polyline) -> Polyline:
    """Return the lines one after the other; of points that nearly meet, the first counts."""
    points: list[tuple[float, float]] = []
    for line in lines:
        for x, y in line.xy.tolist():
            if not points or abs(points[-1][0] - x) + abs(points[-1][1] - y) > LEAST_STEP_M:
                points.append((x, y))
    return build_polyline(points)


def ease(share: float) -> float:
    """Return a smooth step from 0 to 1 as `share` goes from 0 to 1: its slope is 0 at both ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


def buffer_line(line: Polyline, left_m: float, right_m: float) -> Float:
    """Return the outline (K, 2) [m] of the strip between two distances to the left of and to the right of the line."""
    return np.concatenate((shift_line(line, left_m).xy, shift_line(line, -right_m).xy[::-1]))
