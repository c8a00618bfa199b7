"""Poles, signs, traffic lights, street lamps and trees beside lanes: cameras draw and LiDARs hit them in one place.

Networks have signs and traffic lights. Street lamps and trees are made up: they stand where there is room, by numbers
that are drawn from the ids of lanes, so that every episode on a network has the same ones.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.roads import Lane, RoadMap
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
STREET_MPS = 17.0
"""[m/s] Roads with this speed limit or less, about 60 km/h, have street lamps, and trees near their edge."""
LAMP_GAP_M, LAMP_OUTSIDE_M, LAMP_HEIGHT_M, LAMP_ARM_M = 32.0, 1.2, 7.0, 1.3
"""[m] From lamp to lamp along a lane, of its pole from the lane's edge, height, and length of its arm over the lane:
usual sizes for streets of that width, an assumption."""
LAMP_M = (0.24, 0.7, 0.14)
"""[m] Width along the lane, length across it, and height of a lamp's head."""
LAMP_POLE_M = 0.16
TREE_GAP_M, TREE_OUTSIDE_M, TREE_FAR_M, TREE_SHARE = 16.0, 1.4, 7.0, 0.6
"""[m] From tree to tree along a lane, of its trunk from the lane's edge in streets and on faster roads; share of
places with a tree."""
TRUNK_M, TRUNK_HEIGHT_M = 0.24, 2.6
"""[m] Thickness of a trunk, and height of the lowest twigs: above most road users, so that trees hide few."""
CROWN_BOX = 0.8
"""Of the width of a crown, the side of the box that LiDARs hit: a square with the area of its circle has 0.89, and
light passes between leaves."""
CROWN_M, CROWN_HEIGHT_M = (1.3, 2.2), (5.5, 8.5)
"""[m] Least and largest radius of a crown, and of a tree's height."""
END_M = 12.0
"""[m] From the ends of a lane, where junctions and crosswalks are, there is nothing made up."""
LANE_ROOM_M, WALL_ROOM_M, SIGN_ROOM_M = 0.7, 0.6, 3.0
"""[m] Room between what is made up and lanes, walls, and signs or traffic lights."""


class FurnitureKind(IntEnum):
    """Kind of a solid beside the road."""

    POLE = 0
    SIGN = 1
    SIGNAL = 2
    LAMP = 3
    TRUNK = 4
    CROWN = 5


@dataclass(frozen=True, slots=True)
class StreetFurniture:
    """Upright boxes (F,) in the world [m, rad], which may hang above the ground."""

    kinds: tuple[FurnitureKind, ...]
    names: tuple[str, ...]
    """"sign:NUMBER", "signal:LIGHT:INDEX", "lamp:LANE:NUMBER", "crown:LANE:NUMBER", and "pole:" or "trunk:" for what
    carries them."""
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
    """Return all furniture of a map, an octagonal sign as the square of its size, a crown as a box within it."""
    boxes = [*_list_signs(roads), *_list_signals(roads)]
    boxes += _list_made_up(roads, np.array([row[:2] for _, _, row in boxes], dtype=np.float64).reshape(-1, 2))
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


class _Place(NamedTuple):
    """Where something made up may stand."""

    lane: Lane
    number: int
    s: float
    away: float
    """[m] To the right of the lane's centre line, or to the left where the kerb is there."""
    is_lamp: bool
    room: float
    """[m] It needs to walls."""
    size: float
    """Of a tree, in [0, 1)."""

    @property
    def xy(self) -> tuple[float, float]:
        x, y = self.lane.centre.at(self.s)
        cos, sin = portable.cos_sin(self.lane.centre.yaw_at(self.s))
        return x + sin * self.away, y - cos * self.away


def _list_made_up(roads: RoadMap, signs: Float) -> Iterator[_Box]:
    """Yield street lamps and trees. signs: (S, 2) places of signs and traffic lights."""
    kerb: dict[str, int] = {}
    for lane in roads.driving:
        kerb[lane.edge] = min(lane.index, kerb.get(lane.edge, lane.index))
    lanes = [lane for lane in roads.driving if lane.index == kerb[lane.edge]]
    places = [place for lane in lanes for place in _list_places(lane)]
    free = _find_free(roads, places, signs)
    for place, is_free in zip(places, free, strict=True):
        if is_free:
            yield from _build_lamp(place) if place.is_lamp else _build_tree(place)


def _list_places(lane: Lane) -> Iterator[_Place]:
    """Yield the places of a lane beside the kerb, those of lamps first in each stretch."""
    if lane.junction or lane.centre.length < 2 * END_M:
        return
    is_street, side = lane.speed_limit <= STREET_MPS, 1.0 if not lane.right else -1.0
    last = lane.centre.length - END_M
    if is_street:
        for number in range(int((last - END_M) / LAMP_GAP_M) + 1):
            away = side * (lane.width / 2 + LAMP_OUTSIDE_M)
            yield _Place(lane, number, END_M + number * LAMP_GAP_M, away, True, WALL_ROOM_M, 0.0)
    for number in range(int((last - END_M) / TREE_GAP_M)):
        chance, along, aside, size, *_ = draw_uniforms(0, "tree", lane.id, number)
        s = END_M + (number + 0.35 + 0.3 * along) * TREE_GAP_M
        outside = TREE_OUTSIDE_M if is_street else TREE_FAR_M * (1.0 + aside)
        radius = CROWN_M[0] + size * (CROWN_M[1] - CROWN_M[0])
        if chance < TREE_SHARE:
            yield _Place(lane, number, s, side * (lane.width / 2 + outside), False, radius + 0.3, size)


def _find_free(roads: RoadMap, places: Sequence[_Place], signs: Float) -> list[bool]:
    """Return which places are free of lanes, walls and signs."""
    xy = np.array([place.xy for place in places]).reshape(-1, 2)
    lanes = [(lane.centre.xy, lane.width / 2 + LANE_ROOM_M) for lane in roads.driving]
    starts = np.concatenate([np.zeros((0, 2)), *(line[:-1] for line, _ in lanes)])
    ends = np.concatenate([np.zeros((0, 2)), *(line[1:] for line, _ in lanes)])
    room = np.repeat([width for _, width in lanes], [len(line) - 1 for line, _ in lanes])
    is_free = ~_find_near(xy, np.zeros(len(xy)), starts, ends, room)
    shapes = [*roads.building_shapes, *(area.polygon for area in roads.drivable_areas)]
    rings = [np.asarray(ring.coords) for shape in shapes for ring in (shape.exterior, *shape.interiors)]
    starts = np.concatenate([np.zeros((0, 2)), *(ring[:-1] for ring in rings)])
    ends = np.concatenate([np.zeros((0, 2)), *(ring[1:] for ring in rings)])
    own = np.array([place.room for place in places])
    is_free &= ~_find_near(xy, own, starts, ends, np.zeros(len(starts)))
    is_free &= ~_find_near(xy, np.zeros(len(xy)), signs, signs, np.full(len(signs), SIGN_ROOM_M))
    inside, _ = shapely.STRtree(shapes).query(shapely.points(xy), predicate="intersects")
    is_free[inside] = False
    return is_free.tolist()


def _find_near(xy: Float, own: Float, starts: Float, ends: Float, room: Float) -> npt.NDArray[np.bool_]:
    """Return which points (P, 2) are nearer than own (P,) + room (S,) to one of the line segments (S, 2) [m].

    The tree only leaves out what is far away; distances are computed here, in portable digits.
    """
    is_near = np.zeros(len(xy), dtype=np.bool_)
    reach = own.max(initial=0.0) + room.max(initial=0.0) + 1.0
    boxes = shapely.box(*(xy - reach).T, *(xy + reach).T)
    segments = np.atleast_1d(np.asarray(shapely.linestrings(np.stack((starts, ends), axis=1)), dtype=object))
    point, segment = shapely.STRtree(segments).query(boxes)
    start, along = starts[segment], ends[segment] - starts[segment]
    step = xy[point] - start
    length = np.maximum(along[:, 0] * along[:, 0] + along[:, 1] * along[:, 1], 1e-12)
    share = np.clip((step[:, 0] * along[:, 0] + step[:, 1] * along[:, 1]) / length, 0.0, 1.0)
    away = step - share[:, None] * along
    least = own[point] + room[segment]
    is_near[point[away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1] < least * least]] = True
    return is_near


def _build_lamp(place: _Place) -> Iterator[_Box]:
    """Yield pole and head of a street lamp; its arm is too thin for a LiDAR."""
    x, y = place.xy
    yaw = place.lane.centre.yaw_at(place.s)
    cos, sin = portable.cos_sin(yaw)
    inwards = LAMP_ARM_M if place.away > 0 else -LAMP_ARM_M
    width, length, height = LAMP_M
    name = f"lamp:{place.lane.id}:{place.number}"
    yield FurnitureKind.POLE, f"pole:{name}", (x, y, yaw, LAMP_POLE_M, LAMP_POLE_M, 0.0, LAMP_HEIGHT_M)
    head = x - sin * inwards, y + cos * inwards, yaw, width, length
    yield FurnitureKind.LAMP, name, (*head, LAMP_HEIGHT_M - height, LAMP_HEIGHT_M)


def _build_tree(place: _Place) -> Iterator[_Box]:
    """Yield trunk and crown of a tree."""
    x, y = place.xy
    radius = CROWN_M[0] + place.size * (CROWN_M[1] - CROWN_M[0])
    height = CROWN_HEIGHT_M[0] + place.size * (CROWN_HEIGHT_M[1] - CROWN_HEIGHT_M[0])
    yaw, name = place.lane.centre.yaw_at(place.s), f"{place.lane.id}:{place.number}"
    yield FurnitureKind.TRUNK, f"trunk:{name}", (x, y, yaw, TRUNK_M, TRUNK_M, 0.0, TRUNK_HEIGHT_M)
    side = 2 * radius * CROWN_BOX
    yield FurnitureKind.CROWN, f"crown:{name}", (x, y, yaw, side, side, TRUNK_HEIGHT_M, height)
