"""StaticScene: what stands still in a network (ground, markings, buildings, signs, poles) as meshes in chunks."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TypeAlias

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import (
    MapGeometry,
    SignalHead,
    StopMark,
    build_map_geometry,
    list_signal_heads,
)
from mdrive_sumo.roads.drawing.road_paint import build_road_paint
from mdrive_sumo.sensing.camera.meshes import (
    SURFACE_OF_MATERIAL,
    Colour,
    Material,
    Mesh,
    build_block,
    build_mesh,
    extrude_outline,
    join_meshes,
    triangulate_polygons,
)
from mdrive_sumo.sensing.lidar_world import BUILDING_M

LINE_M, STOP_LINE_M = 0.15, 0.4
"""[m] Widths of lane markings and stop lines."""
KERB_M = 0.16
"""[m] Width of a kerb."""
CHUNK_M = 64.0
"""[m] Side of the squares by which triangles are drawn or left out."""
SURROUNDINGS_M = 1000.0
"""[m] Around the lanes; buildings farther away are left out."""
POLE_M = 0.12
"""[m] Diameter of the pole of a sign or light."""
SIGN_HEIGHT_M, SIGN_RADIUS_M = 2.3, 0.42
HOUSING_M = (0.3, 0.36, 1.0)
"""[m] Depth, width and height of a traffic light."""
HOUSING_LOW_M, HOUSING_GAP_M = 2.7, 0.5
OUTSIDE_M = 0.9
"""[m] Distance of a traffic light's pole from the edge of its lane."""
GRID_M = 8192.0
"""[m] Vertices are first rounded to single precision relative to a multiple of it: large coordinates lose no digits."""
GROUND_LAYERS = 5
"""Of roads, pavements and paint; the terrain lies below them."""
GREY: Colour = (120, 122, 124)
RED: Colour = (190, 30, 38)


MeshBuilder: TypeAlias = Callable[..., Mesh]
"""`build_mesh`, relative to the scene's multiple of GRID_M."""


@dataclass(frozen=True, slots=True)
class Chunks:
    """Parts of a static scene that are drawn or left out as a whole; arrays (K,), in the order of drawing."""

    surface: Int
    """`Surface`, ascending."""
    first: Int
    """Index of the first vertex."""
    count: Int
    """Number of vertices."""
    centre: Float
    """(K, 2) [m], relative to the origin."""
    radius: Float
    """[m]"""


@dataclass(frozen=True, slots=True)
class SignalLamps:
    """Traffic lights with their housings, whose state changes; arrays of L lamps."""

    names: tuple[str, ...]
    """"tls:index"."""
    place: Float
    """(L, 3) lowest point of the housing's front [m], relative to the origin."""
    turn: Float
    """(L, 2) cosine and sine of the direction that the front faces."""


@dataclass(frozen=True, eq=False, slots=True)
class StaticScene:
    """Meshes of a network."""

    origin: Float
    """(3,) [m] of the vertices in the world: single precision is too coarse for large coordinates."""
    vertices: Mesh
    chunks: Chunks
    lamps: SignalLamps


@lru_cache(maxsize=2)
def load_static_scene(roads: RoadMap) -> StaticScene:
    """Return the scene of a network; those of the last two are kept."""
    whole = find_surroundings(np.concatenate([lane.centre.xy for lane in roads.driving]))
    middle = shapely.get_coordinates(whole.centroid)[0].round()
    origin = np.array((*middle, 0.0))
    mesh, lamps = build_scene_meshes(roads, whole, origin)
    return StaticScene(origin, *_cut_into_chunks(mesh), lamps)


def build_scene_meshes(roads: RoadMap, area: BaseGeometry, origin: Float) -> tuple[Mesh, SignalLamps]:
    """Return what stands still in an area, relative to an origin (3,) [m], and its traffic lights.

    Solids come first, then the ground from top to bottom: a pixel is shaded about once.
    """
    geometry, heads = build_map_geometry(roads, area), list_signal_heads(roads, area)
    corner = GRID_M * np.round(origin / GRID_M)
    build = partial(build_mesh, origin=corner)
    mesh = join_meshes([*_build_solids(geometry, heads, build), *_build_ground(geometry, build)])
    return _move(mesh, origin - corner), _build_lamps(heads, origin)


def find_surroundings(points: Float) -> shapely.Polygon:
    """Return the box around points (N, 2) [m] and all that may be seen from them.

    A buffer of the points has the same envelope; of the thousands of a large network it takes minutes and gigabytes.
    """
    least, most = points.min(axis=0) - SURROUNDINGS_M, points.max(axis=0) + SURROUNDINGS_M
    return shapely.box(*least.tolist(), *most.tolist())


def _move(mesh: Mesh, by: Float) -> Mesh:
    mesh["position"] -= by.astype(np.float32)
    return mesh


def _build_ground(geometry: MapGeometry, build: MeshBuilder) -> Iterator[Mesh]:
    """Yield the layers of the ground from top to bottom."""
    road, walk, line = SemanticClass.ROAD, SemanticClass.SIDEWALK, SemanticClass.ROAD_LINE
    paint = build_road_paint(geometry, LINE_M, STOP_LINE_M)
    layers: tuple[tuple[Sequence[shapely.Polygon], Colour, SemanticClass, Material], ...] = (
        (paint, (226, 226, 222), line, Material.PLAIN),
        (_build_kerbs(geometry), (196, 194, 188), walk, Material.PLAIN),
        (geometry.asphalt, (84, 85, 88), road, Material.ROUGH),
        (geometry.aprons, (104, 104, 106), road, Material.ROUGH),
        (geometry.pavements, (158, 156, 150), walk, Material.ROUGH),
    )
    for layer, (shapes, colour, semantic, material) in enumerate(layers, start=1):
        yield build(triangulate_polygons(shapes, 0.0), colour, semantic, material, layer)


def _build_kerbs(geometry: MapGeometry) -> list[shapely.Polygon]:
    """Return strips along the edge of the asphalt where there is a pavement."""
    walks = shapely.union_all(list(geometry.pavements)).buffer(0.4)
    edges = shapely.union_all([shape.boundary for shape in geometry.asphalt])
    strips = shapely.intersection(edges, walks).buffer(KERB_M / 2, cap_style="flat", quad_segs=1)
    return [part for part in shapely.get_parts(strips).tolist() if isinstance(part, shapely.Polygon)]


def _build_solids(geometry: MapGeometry, heads: Sequence[SignalHead], build: MeshBuilder) -> Iterator[Mesh]:
    for shape in geometry.buildings:
        ring = shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1]
        walls, roof = extrude_outline(ring, 0.0, BUILDING_M)
        tone = int(abs(ring[0].sum())) % 3
        colour = ((186, 170, 150), (168, 164, 160), (190, 150, 128))[tone]
        yield build(walls, colour, SemanticClass.BUILDING, Material.FACADE)
        yield build(roof, (120, 110, 104), SemanticClass.BUILDING)
    for mark in geometry.stop_signs:
        if mark.sign is not None:
            yield from _build_stop_sign(mark, build)
    for head in heads:
        yield from _build_signal(head, build)


def _build_pole(x: float, y: float, height: float, build: MeshBuilder) -> Mesh:
    half = POLE_M / 2
    return build(build_block((x - half, y - half, 0.0), (x + half, y + half, height)), GREY, SemanticClass.POLE)


def _build_stop_sign(mark: StopMark, build: MeshBuilder) -> Iterator[Mesh]:
    """Yield the pole and both sides of an octagon that faces the lane."""
    assert mark.sign is not None
    across = (mark.line[1] - mark.line[0]) / portable.hypot(*(mark.line[1] - mark.line[0]))
    x, y = mark.sign.tolist()
    yield _build_pole(x, y, SIGN_HEIGHT_M, build)
    cos, sin = portable.cos_sin((np.arange(8) + 0.5) * math.pi / 4)
    ring = np.column_stack(
        (
            mark.sign + across * (SIGN_RADIUS_M * cos)[:, None],
            SIGN_HEIGHT_M + SIGN_RADIUS_M * sin,
        )
    )
    ahead = np.array((-across[1], across[0], 0.0)) * (POLE_M / 2 + 0.01)
    for side, colour, order in ((-ahead, RED, 1), (ahead, GREY, -1)):
        corners = (ring + side)[::order]
        fan = np.stack((np.broadcast_to(corners[:1], (6, 3)), corners[1:-1], corners[2:]), axis=1)
        yield build(fan, colour, SemanticClass.TRAFFIC_SIGN)


def _place_housings(head: SignalHead) -> Iterator[tuple[float, float]]:
    """Yield the middle of every housing of a signal head [m]."""
    across = _find_right(head.yaw)
    for i in range(len(head.lights)):
        x, y = (head.place + across * (head.width / 2 + OUTSIDE_M + HOUSING_GAP_M * i)).tolist()
        yield x, y


def _find_right(yaw: float) -> Float:
    cos, sin = portable.cos_sin(yaw)
    return np.array((sin, -cos))


def _build_signal(head: SignalHead, build: MeshBuilder) -> Iterator[Mesh]:
    depth, width, height = HOUSING_M
    cos, sin = portable.cos_sin(head.yaw)
    turn = np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)))
    low = (-depth / 2, -width / 2, HOUSING_LOW_M)
    block = build_block(low, (depth / 2, width / 2, HOUSING_LOW_M + height))
    for x, y in _place_housings(head):
        yield _build_pole(x, y, HOUSING_LOW_M, build)
        yield build(block @ turn + (x, y, 0.0), (34, 36, 36), SemanticClass.TRAFFIC_LIGHT)


def _build_lamps(heads: Sequence[SignalHead], origin: Float) -> SignalLamps:
    rows = [
        (name, x, y, head.yaw + math.pi)
        for head in heads
        for name, (x, y) in zip(head.lights, _place_housings(head), strict=True)
    ]
    yaw = np.array([row[3] for row in rows])
    turn = np.stack(portable.cos_sin(yaw), axis=-1).reshape(-1, 2)
    place = np.array([(x, y, HOUSING_LOW_M) for _, x, y, _ in rows]).reshape(-1, 3) - origin
    place[:, :2] += turn * (HOUSING_M[0] / 2)
    return SignalLamps(tuple(row[0] for row in rows), place, turn)


def _cut_into_chunks(mesh: Mesh) -> tuple[Mesh, Chunks]:
    """Return the triangles ordered by surface, layer, and square of their middle, and the parts so found."""
    corners = mesh["position"].reshape(-1, 3, 3).astype(np.float64)
    if not len(corners):
        none = np.zeros(0, dtype=np.int64)
        return mesh, Chunks(none, none, none, np.zeros((0, 2)), np.zeros(0))
    kind = mesh["kind"][::3].astype(np.int64)
    surface = np.array([SURFACE_OF_MATERIAL[material] for material in Material])[kind[:, 1]]
    cell = np.floor(corners[:, :, :2].mean(axis=1) / CHUNK_M).astype(np.int64)
    key = np.column_stack((surface, kind[:, 2], cell))
    cells, number, sizes = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(number.reshape(-1), kind="stable")
    ends = np.cumsum(sizes)
    ordered = corners[order][:, :, :2]
    groups = [ordered[end - size : end].reshape(-1, 2) for end, size in zip(ends.tolist(), sizes.tolist(), strict=True)]
    centre = np.array([(group.min(axis=0) + group.max(axis=0)) / 2 for group in groups])
    radius = np.array([portable.hypot(*(group - middle).T).max() for group, middle in zip(groups, centre, strict=True)])
    rows = (3 * order[:, None] + np.arange(3)).reshape(-1)
    return mesh[rows], Chunks(cells[:, 0], 3 * (ends - sizes), 3 * sizes, centre, radius)
