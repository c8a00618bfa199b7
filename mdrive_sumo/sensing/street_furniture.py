"""Poles, stop signs and traffic lights beside the lanes: cameras draw them and LiDARs hit them in the same places."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import SignalHead, list_signal_heads, list_stop_signs

POLE_M = 0.12
"""[m] Diameter of the pole of a sign or light."""
SIGN_HEIGHT_M, SIGN_RADIUS_M = 2.3, 0.42
SIGN_THICKNESS_M = 0.02
HOUSING_M = (0.3, 0.36, 1.0)
"""[m] Depth, width and height of a traffic light."""
HOUSING_LOW_M, HOUSING_GAP_M = 2.7, 0.5
OUTSIDE_M = 0.9
"""[m] Distance of a traffic light's pole from the edge of its lane."""


class FurnitureKind(IntEnum):
    """Kind of a solid beside the road."""

    POLE = 0
    SIGN = 1
    SIGNAL = 2


@dataclass(frozen=True, slots=True)
class StreetFurniture:
    """Upright boxes (F,) in the world [m, rad], which may hang above the ground."""

    kinds: tuple[FurnitureKind, ...]
    names: tuple[str, ...]
    """"sign:NUMBER" and "signal:LIGHT:INDEX", "pole:" before the name of what stands on it."""
    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float
    foot: Float
    """Height of the lower edge."""
    top: Float


@lru_cache(maxsize=8)
def load_street_furniture(roads: RoadMap) -> StreetFurniture:
    """Return all poles, signs and traffic lights of a map, an octagonal sign as the square of its size."""
    boxes = [*_list_signs(roads), *_list_signals(roads)]
    rows = np.array([row for *_, row in boxes], dtype=np.float64).reshape(-1, 7)
    return StreetFurniture(tuple(kind for kind, *_ in boxes), tuple(name for _, name, _ in boxes), *rows.T.copy())


def place_housings(head: SignalHead) -> Iterator[tuple[float, float]]:
    """Yield the middle of every housing of a signal head [m]."""
    cos, sin = portable.cos_sin(head.yaw)
    across = np.array((sin, -cos))
    for i in range(len(head.lights)):
        x, y = (head.place + across * (head.width / 2 + OUTSIDE_M + HOUSING_GAP_M * i)).tolist()
        yield x, y


_Box = tuple[FurnitureKind, str, tuple[float, ...]]
"""Kind, name, and the numbers of `StreetFurniture` in their order."""


def _list_signs(roads: RoadMap) -> Iterator[_Box]:
    for i, mark in enumerate(list_stop_signs(roads, roads.driving)):
        if mark.sign is None:
            continue
        x, y = mark.sign.tolist()
        ahead, left = (mark.line[0] - mark.line[1]).tolist()  # across the lane: the sign faces along it
        yaw = portable.atan2(left, ahead) - math.pi / 2
        low, high = SIGN_HEIGHT_M - SIGN_RADIUS_M, SIGN_HEIGHT_M + SIGN_RADIUS_M
        name = f"sign:{i}"
        yield FurnitureKind.POLE, f"pole:{name}", (x, y, yaw, POLE_M, POLE_M, 0.0, low)
        yield FurnitureKind.SIGN, name, (x, y, yaw, SIGN_THICKNESS_M, 2 * SIGN_RADIUS_M, low, high)


def _list_signals(roads: RoadMap) -> Iterator[_Box]:
    depth, width, height = HOUSING_M
    for head in list_signal_heads(roads):
        for light, (x, y) in zip(head.lights, place_housings(head), strict=True):
            name, high = f"signal:{light}", HOUSING_LOW_M + height
            yield FurnitureKind.POLE, f"pole:{name}", (x, y, head.yaw, POLE_M, POLE_M, 0.0, HOUSING_LOW_M)
            yield FurnitureKind.SIGNAL, name, (x, y, head.yaw, depth, width, HOUSING_LOW_M, high)
