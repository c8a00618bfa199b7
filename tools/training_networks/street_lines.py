"""Lines of streets: straight pieces and arcs, one after the other."""

import math
import random
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.geometry import Float

Piece = tuple[float, float]
"""Length [m] and signed radius [m] of an arc: positive turns left, 0 is straight."""
ARC_STEP_M = 4.0


def trace_line(start: tuple[float, float], heading: float, pieces: Sequence[Piece]) -> Float:
    """Return points (N, 2) [m] along the pieces, from `start` in direction `heading` [rad]."""
    x, y = start
    points = [start]
    for length, radius in pieces:
        step = min(ARC_STEP_M, abs(radius) / 5) if radius else length
        count = max(math.ceil(length / step), 1) if radius else 1
        for _ in range(count):
            turn = length / count / radius if radius else 0.0
            chord = 2 * abs(radius) * math.sin(abs(turn) / 2) if radius else length
            x, y = x + chord * math.cos(heading + turn / 2), y + chord * math.sin(heading + turn / 2)
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
