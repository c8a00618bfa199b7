"""Meshes: triangles with normals, colours, semantic classes and materials, and the solids they are made of."""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

VERTEX = np.dtype([("position", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 4), ("kind", "u1", 4)])
"""A corner of a triangle: position [m], unit normal, RGB and padding, and semantic class, material, layer of the ground
(0 for solids, 1 for the topmost), padding."""
VERTEX_FORMAT = "3f4 3f4 4f1 4u1"
"""The same for moderngl."""
Mesh: TypeAlias = npt.NDArray[np.void]
"""(3 T,) of `VERTEX`: T triangles, counter-clockwise from outside."""
Colour: TypeAlias = tuple[int, int, int]
Corner: TypeAlias = tuple[float, float, float]


class Material(IntEnum):
    """How a surface is shaded; the numbers are those of the shaders."""

    PLAIN = 0
    PAINT = 1
    """The colour of the instance."""
    FACADE = 2
    """A wall with windows."""
    ROUGH = 3
    """Asphalt, grass: brightness varies from place to place."""
    HEADLAMP = 4
    TAIL_LAMP = 5
    BRAKE_LAMP = 6
    """The third one of a car, which is dark when it does not brake."""
    SIGNAL = 7
    """Shines in the colour of the instance."""
    STRIPES = 8
    """Red and white, as on barriers."""
    LEFT_INDICATOR = 9
    RIGHT_INDICATOR = 10


class Surface(IntEnum):
    """Materials that one program of the renderer draws."""

    FACADE = 0
    STRIPES = 1
    PLAIN = 2
    ROUGH = 3


SURFACE_OF_MATERIAL = {
    **dict.fromkeys(Material, Surface.PLAIN),
    Material.FACADE: Surface.FACADE,
    Material.STRIPES: Surface.STRIPES,
    Material.ROUGH: Surface.ROUGH,
}


def build_mesh(
    triangles: Float,
    colour: Colour,
    semantic: SemanticClass,
    material: Material = Material.PLAIN,
    layer: int = 0,
    origin: Float | None = None,
) -> Mesh:
    """Return triangles (T, 3, 3) [m], counter-clockwise from outside, as a mesh.

    layer: of the ground; 1 is the top. origin: (3,) what the mesh is relative to, None: the same as the triangles.
    """
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.maximum(np.sqrt(portable.square(normals).sum(-1, keepdims=True)), 1e-12)
    mesh = np.zeros(3 * len(triangles), dtype=VERTEX)
    mesh["position"] = (triangles if origin is None else triangles - origin).reshape(-1, 3)
    mesh["normal"] = np.repeat(normals, 3, axis=0)
    mesh["colour"] = (*colour, 255)
    mesh["kind"] = (semantic, material, layer, 0)
    return mesh


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Return all triangles of some meshes."""
    return np.concatenate([np.zeros(0, dtype=VERTEX), *meshes])


def triangulate_polygons(shapes: Sequence[shapely.Polygon], z: float) -> Float:
    """Return triangles (T, 3, 3) that cover polygons at a height z [m], facing up."""
    if not shapes:
        return np.zeros((0, 3, 3))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(np.array(shapes, dtype=object)))
    corners = shapely.get_coordinates(shapely.orient_polygons(parts)).reshape(-1, 4, 2)[:, :3]
    return np.concatenate((corners, np.full((*corners.shape[:2], 1), z)), axis=-1)


def build_quads(quads: Float) -> Float:
    """Return quadrilaterals (Q, 4, 3), counter-clockwise from outside, as triangles (2 Q, 3, 3)."""
    return quads[:, (0, 1, 2, 0, 2, 3)].reshape(-1, 3, 3)


def extrude_outline(outline: Float, low: float, high: float) -> tuple[Float, Float]:
    """Return the walls and the roof, as triangles (T, 3, 3), above an outline (N, 2), counter-clockwise [m]."""
    following = np.roll(outline, -1, axis=0)
    bottom, top = np.full((len(outline), 1), low), np.full((len(outline), 1), high)
    quads = (np.hstack((outline, bottom)), np.hstack((following, bottom)), np.hstack((following, top)))
    walls = build_quads(np.stack((*quads, np.hstack((outline, top))), axis=1))
    return walls, triangulate_polygons([shapely.Polygon(outline)], high)


def build_frustum(bottom: tuple[Corner, Corner], top: tuple[Corner, Corner]) -> Float:
    """Return the triangles (12, 3, 3) of a solid between two level rectangles, each from corner (x, y, z) to corner."""
    (ax, ay, az), (bx, by, _) = bottom
    (cx, cy, cz), (dx, dy, _) = top
    base = np.array(((ax, ay, az), (bx, ay, az), (bx, by, az), (ax, by, az)))
    roof = np.array(((cx, cy, cz), (dx, cy, cz), (dx, dy, cz), (cx, dy, cz)))
    sides = [(base[i], base[(i + 1) % 4], roof[(i + 1) % 4], roof[i]) for i in range(4)]
    return build_quads(np.array([*sides, roof, base[::-1]]))


def build_block(low: Corner, high: Corner) -> Float:
    """Return the triangles (12, 3, 3) of an upright block from its lowest to its highest corner."""
    return build_frustum((low, (high[0], high[1], low[2])), ((low[0], low[1], high[2]), high))


def build_wheel(x: float, y: tuple[float, float], radius: float, corners: int = 12) -> Float:
    """Return the triangles (T, 3, 3) of a wheel that stands on the ground at x between two values of y [m]: its
    tread, its right side and its left side."""
    discs = [build_disc((x, y[0], radius), radius, corners), build_disc((x, y[1], radius), radius, corners)[:, ::-1]]
    right, left = discs[0][:, 1], discs[1][:, 1]
    tread = np.stack((right, left, np.roll(left, -1, axis=0), np.roll(right, -1, axis=0)), axis=1)
    return np.concatenate((build_quads(tread), *discs))


def build_disc(middle: Corner, radius: float, corners: int) -> Float:
    """Return the triangles (corners, 3, 3) of an upright disc around a point, which faces right (-y) [m]."""
    angles = np.arange(corners + 1) * (2 * math.pi / corners) - math.pi / 2
    cos, sin = portable.cos_sin(angles)
    ring = np.array(middle) + np.column_stack((radius * cos, np.zeros(corners + 1), radius * sin))
    return np.stack((np.broadcast_to(np.array(middle), (corners, 3)), ring[:-1], ring[1:]), axis=1)
