"""Bounds and outlines of lanes, which a SUMO network has as centre lines with widths."""

from collections import defaultdict

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import Lane, RoadMap


def offset_points(points: Float, left_m: float) -> Float:
    """Return points (N, 2) shifted to the left, perpendicular to the mean direction of their two segments."""
    ahead = np.diff(points, axis=0)
    ahead /= portable.hypot(ahead[:, 0], ahead[:, 1])[:, None]
    mean = np.concatenate((ahead[:1], ahead)) + np.concatenate((ahead, ahead[-1:]))
    mean /= np.maximum(portable.hypot(mean[:, 0], mean[:, 1]), 1e-9)[:, None]
    return points + left_m * np.column_stack((-mean[:, 1], mean[:, 0]))


def compute_bounds(lane: Lane) -> tuple[Float, Float]:
    """Return the left and the right bound (N, 2) [m], with as many points as the centre line."""
    return offset_points(lane.centre.xy, lane.width / 2), offset_points(lane.centre.xy, -lane.width / 2)


def compute_outline(lane: Lane) -> Float:
    """Return the corners (2 N, 2) [m] of a lane's area: the left bound, then the right one backwards."""
    left, right = compute_bounds(lane)
    return np.concatenate((left, right[::-1]))


def find_predecessors(roads: RoadMap) -> dict[str, tuple[str, ...]]:
    """Return the ids of the lanes that lead into each lane, by its id."""
    entries: defaultdict[str, list[str]] = defaultdict(list)
    for lane in roads.driving:
        for successor in lane.successors:
            entries[successor].append(lane.id)
    return {lane.id: tuple(entries[lane.id]) for lane in roads.driving}
