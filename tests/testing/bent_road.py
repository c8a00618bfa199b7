"""A road that bends all along, its briefing, and boxes on it: for tests of detours and obstacle avoidance."""

import math
from functools import lru_cache
from pathlib import Path

import numpy as np

from mdrive_sumo.contract import Briefing, Objects
from mdrive_sumo.core.geometry import Float, Polyline, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.sensing.briefing_builder import build_briefing
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts
from testing.agents_driving import ego

CAR = to_vehicle_facts(MKZ_2017)
WIDTH = 3.5


def bent(radius: float, length: float = 120.0, aside: float = 0.0) -> Float:
    """A line that bends to the left (right, if negative) all along, `aside` metres to its left."""
    s = np.arange(0.0, length + 0.5, 1.0)
    yaw = s / radius
    return np.column_stack(
        (radius * np.sin(yaw) - aside * np.sin(yaw), radius * (1 - np.cos(yaw)) + aside * np.cos(yaw))
    )


def road(radius: float, oncoming: int = 1) -> RoadMap:
    """One lane, and so many of the other direction to its left."""

    def lane(name: str, xy: Float) -> Lane:
        return Lane(name, name, 0, WIDTH, 13.89, Polyline(xy), False, (), "", "", {})

    lanes = {"r_0": lane("r_0", bent(radius))}
    for i in range(oncoming):
        lanes[f"l_{i}"] = lane(f"l_{i}", bent(radius, aside=WIDTH * (i + 1))[::-1])
    return RoadMap("bent", Path("/nowhere"), lanes, (), (), (), (), (), "none")


@lru_cache
def told(radius: float, oncoming: int = 1) -> Briefing:
    """The briefing of a CAV that drives along the bent road."""
    return build_briefing(ego("0", bent(radius)), road(radius, oncoming), CAR, 0, 100.0)


def box(path_xy: Float, at: int, aside: float, length: float, width: float, turned: float = 0.0) -> Float:
    """Corners (4, 2) of a box beside the chain's point."""
    (x, y), yaw = path_xy[at], Polyline(path_xy).yaws[at]
    x, y = x - math.sin(yaw) * aside, y + math.cos(yaw) * aside
    return boxes_corners(*(np.array(v) for v in (x, y, yaw + turned, length, width)))


def things(*rows: tuple[float, float, float], kind: Kind = Kind.STATIC) -> Objects:
    """Boxes of a car's size at x, y [m] that look east, with a speed [m/s]."""
    x, y, speed = np.array(rows).reshape(-1, 3).T
    size = np.ones(len(x))
    names = tuple(f"b{i}" for i in range(len(x)))
    return Objects(names, np.full(len(x), kind, dtype=np.uint8), x, y, 0 * x, speed, 4.5 * size, 1.8 * size)
