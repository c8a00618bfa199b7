"""Lines of streets: straight pieces and arcs, one after the other."""

import math
import random
from collections.abc import Sequence

import numpy as np
import shapely
from shapely import ops

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

Piece = tuple[float, float]
"""Length [m] and signed radius [m] of an arc: positive turns left, 0 is straight."""
ARC_STEP_M = 4.0
"""[m] Distance of points on an arc at most: the chord of a bend of 70 m then lies 3 cm beside it."""


def trace_line(start: tuple[float, float], heading: float, pieces: Sequence[Piece]) -> Float:
    """Return points (N, 2) [m] along the pieces, from `start` in direction `heading` [rad]."""
    x, y = start
    points = [start]
    for length, radius in pieces:
        step = min(ARC_STEP_M, abs(radius) / 5) if radius else length
        count = max(math.ceil(length / step), 1) if radius else 1
        for _ in range(count):
            turn = length / count / radius if radius else 0.0
            chord = 2 * abs(radius) * portable.sin(abs(turn) / 2) if radius else length
            x, y = x + chord * portable.cos(heading + turn / 2), y + chord * portable.sin(heading + turn / 2)
            heading += turn
            points.append((x, y))
    return np.array(points, dtype=np.float64).round(1)


def compute_end_heading(heading: float, pieces: Sequence[Piece]) -> float:
    """Return the direction [rad] at the end of the pieces."""
    return heading + math.fsum(length / radius for length, radius in pieces if radius)


def draw_arm(rng: random.Random, length: float, bend: float) -> list[Piece]:
    """Return the pieces of an arm from its junction outwards: straight at the junction, then perhaps an arc.

    bend: share of arms with an arc of 40 to 160 m radius.
    """
    straight = rng.uniform(22.0, 30.0)
    if rng.random() >= bend:
        return [(length, 0.0)]
    arc = rng.uniform(0.35, 0.6) * length
    radius = rng.choice((-1, 1)) * rng.uniform(40.0, 160.0)
    return [(straight, 0.0), (min(arc, abs(radius)), radius), (max(length - straight - arc, 8.0), 0.0)]


def offset_line(line: Float, offset_m: float) -> Float:
    """Return a line (N, 2) [m] parallel to a line, on its left if `offset_m` is positive; its bends must be wider."""
    steps = np.diff(line, axis=0)
    normals = np.stack((-steps[:, 1], steps[:, 0]), 1) / portable.hypot(steps[:, 0], steps[:, 1])[:, None]
    before, after = np.concatenate((normals[:1], normals)), np.concatenate((normals, normals[-1:]))
    return line + offset_m * (before + after) / (1.0 + portable.dot(before, after))[:, None]


def cut_line(line: Float, begin_m: float, end_m: float) -> Float:
    """Return the part (N, 2) [m] of a line from `begin_m` on to `end_m` before its end."""
    whole = shapely.LineString(line)
    return shapely.get_coordinates(ops.substring(whole, begin_m, whole.length - end_m))


def measure_line(line: Float) -> float:
    """Return the length [m] of a line."""
    steps = np.diff(line, axis=0)
    return math.fsum(portable.hypot(steps[:, 0], steps[:, 1]).tolist())
