"""Solid models of street lamps and trees, of our own making, where the street furniture has them."""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.sensing.camera.meshes import Colour, Material, Mesh, build_block, build_quads
from mdrive_sumo.sensing.street_furniture import CROWN_BOX, LAMP_ARM_M, FurnitureKind, StreetFurniture

BARK: Colour = (92, 74, 58)
LEAVES: tuple[Colour, ...] = ((74, 104, 50), (88, 116, 56), (66, 94, 56), (104, 118, 58))
LAMP_GREY: Colour = (98, 100, 102)
CROWN_CORNERS = 7
CROWN_RINGS = ((0.0, 0.35), (0.22, 0.85), (0.5, 1.0), (0.8, 0.72), (1.0, 0.2))
"""Height of each ring of a crown, as a share of its height, and its radius, as a share of the crown's."""
MeshBuilder = Callable[..., Mesh]


def find_street_lamps(furniture: StreetFurniture) -> Float:
    """Return where street lamps hang (L, 2) [m]."""
    rows = [i for i, kind in enumerate(furniture.kinds) if kind is FurnitureKind.LAMP]
    return np.column_stack((furniture.x[rows], furniture.y[rows]))


def build_made_up(furniture: StreetFurniture, area: BaseGeometry, build: MeshBuilder) -> Iterator[Mesh]:
    """Yield the meshes of street lamps and trees in an area; signs and traffic lights are elsewhere."""
    is_inside = shapely.contains_xy(area, furniture.x, furniture.y).tolist()
    for i, (kind, name) in enumerate(zip(furniture.kinds, furniture.names, strict=True)):
        if not is_inside[i] or (kind is FurnitureKind.POLE and not name.startswith("pole:lamp:")):
            continue
        if kind is FurnitureKind.POLE:
            yield build(_place_block(furniture, i), LAMP_GREY, SemanticClass.POLE)
        elif kind is FurnitureKind.LAMP:
            yield build(_place_block(furniture, i), LAMP_GREY, SemanticClass.POLE, Material.STREET_LAMP)
            yield build(_place_arm(furniture, i), LAMP_GREY, SemanticClass.POLE)
        elif kind is FurnitureKind.TRUNK:
            yield build(_place_block(furniture, i), BARK, SemanticClass.VEGETATION)
        elif kind is FurnitureKind.CROWN:
            yield build(_place_crown(furniture, i), LEAVES[i % len(LEAVES)], SemanticClass.VEGETATION)


def _place(furniture: StreetFurniture, row: int, triangles: Float) -> Float:
    """Return triangles (T, 3, 3) of a model around the origin where a row of the furniture is."""
    cos, sin = portable.cos_sin(float(furniture.yaw[row]))
    turn = np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)))
    return triangles @ turn + (furniture.x[row], furniture.y[row], 0.0)


def _place_block(furniture: StreetFurniture, row: int) -> Float:
    half = furniture.length[row] / 2, furniture.width[row] / 2
    foot, top = furniture.foot[row], furniture.top[row]
    return _place(furniture, row, build_block((-half[0], -half[1], foot), (*half, top)))


def _place_arm(furniture: StreetFurniture, row: int) -> Float:
    """Return the arm from a lamp to its pole, which is the row before it."""
    aside = (furniture.x[row - 1] - furniture.x[row], furniture.y[row - 1] - furniture.y[row])
    cos, sin = portable.cos_sin(float(furniture.yaw[row]))
    end = LAMP_ARM_M if cos * aside[1] - sin * aside[0] > 0 else -LAMP_ARM_M
    top = furniture.top[row]
    return _place(furniture, row, build_block((-0.05, min(0.0, end), top - 0.1), (0.05, max(0.0, end), top)))


def _place_crown(furniture: StreetFurniture, row: int) -> Float:
    """Return a round crown around the box that LiDARs hit, whose corners are turned a little from ring to ring."""
    radius, foot, height = (
        furniture.length[row] / (2 * CROWN_BOX),
        furniture.foot[row],
        furniture.top[row] - furniture.foot[row],
    )
    angles = np.arange(CROWN_CORNERS) * (2 * math.pi / CROWN_CORNERS)
    rings: list[Float] = []
    for number, (share, wide) in enumerate(CROWN_RINGS):
        cos, sin = portable.cos_sin(angles + 0.45 * number)
        uneven = 1.0 + 0.12 * np.array([(3 * k + 2 * number) % 5 - 2 for k in range(CROWN_CORNERS)]) / 2
        level = np.full(CROWN_CORNERS, foot - 0.3 + share * (height + 0.3))
        rings.append(np.column_stack((radius * wide * uneven * cos, radius * wide * uneven * sin, level)))
    sides = [
        build_quads(np.stack((low, np.roll(low, -1, axis=0), np.roll(high, -1, axis=0), high), axis=1))
        for low, high in pairwise(rings)
    ]
    top, bottom = (
        np.stack((ring, np.roll(ring, -1, axis=0), np.broadcast_to(ring.mean(axis=0), ring.shape)), axis=1)
        for ring in (rings[-1], rings[0])
    )
    return _place(furniture, row, np.concatenate((*sides, top, bottom[:, ::-1])))
