"""Simple solid models of cars, vans, trucks and buses, of our own making [m]: x ahead, y left, z up from the ground."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.sensing.camera.meshes import (
    Colour,
    Corner,
    Material,
    Mesh,
    build_block,
    build_disc,
    build_frustum,
    build_mesh,
    build_quads,
    build_wheel,
    join_meshes,
)

GLASS: Colour = (38, 46, 56)
RUBBER: Colour = (24, 24, 26)
HUB: Colour = (118, 120, 124)
TRIM: Colour = (58, 60, 64)
CARGO: Colour = (206, 208, 210)
PLATE: Colour = (222, 222, 214)
HEADLAMP: Colour = (236, 236, 222)
TAIL_LAMP: Colour = (120, 18, 22)
BRAKE_LAMP: Colour = (84, 16, 18)
INDICATOR: Colour = (168, 98, 26)
INDICATOR_M = 0.14
"""[m] Width of an indicator, which goes around the corner of a vehicle."""
TYRE_M = 0.22
"""[m] Width of a tyre."""
FACE_M = 0.012
"""[m] By which lamps and windows lie in front of the body: a step of the depth buffer is 6 mm at 100 m."""


def paint_mesh(triangles: Float, semantic: SemanticClass = SemanticClass.VEHICLE) -> Mesh:
    """Return a part in the colour of its road user."""
    return build_mesh(triangles, (255, 255, 255), semantic, Material.PAINT)


def build_part(
    triangles: Float,
    colour: Colour,
    semantic: SemanticClass = SemanticClass.VEHICLE,
    material: Material = Material.PLAIN,
) -> Mesh:
    """Return a part of a road user in a colour of its own."""
    return build_mesh(triangles, colour, semantic, material)


def build_centred(low: tuple[float, float], half: float, high: tuple[float, float]) -> Float:
    """Return a block from (x, z) to (x, z) that reaches `half` to both sides [m]."""
    return build_block((low[0], -half, low[1]), (high[0], half, high[1]))


def _assemble(
    parts: Sequence[Mesh],
    size: Corner,
    lamps: tuple[float, float, float],
    axles: tuple[float, ...],
    radius: float,
    is_fine: bool,
) -> tuple[Mesh, Corner]:
    """Return a vehicle of a size with its parts, lamps (lowest and highest point, breadth), and wheels at `axles`."""
    length, width, _ = size
    details = _build_plates(length, lamps[0]) if is_fine else []
    wheels = _build_wheels(axles, width, radius, is_fine)
    return join_meshes([*parts, *_build_lamps(length, width, lamps), *details, *wheels]), size


def _build_lamps(length: float, width: float, lamps: tuple[float, float, float]) -> list[Mesh]:
    """Return head lamps, tail lamps and indicators, as faces just in front of the body."""
    low, high, breadth = lamps
    half = width / 2
    middle, inner = half - INDICATOR_M, half - INDICATOR_M - breadth
    ends = ((1, HEADLAMP, Material.HEADLAMP), (-1, TAIL_LAMP, Material.TAIL_LAMP))
    sides = ((1, Material.LEFT_INDICATOR), (-1, Material.RIGHT_INDICATOR))
    meshes: list[Mesh] = []
    for end, colour, material in ends:
        x = end * length / 2
        for side, indicator in sides:
            lamp = _build_end_face(end, x, (side * inner, side * middle), (low, high))
            corner = (
                _build_end_face(end, x, (side * middle, side * half), (low, high)),
                _build_side_face(side, side * half, (x, x - end * INDICATOR_M), (low, high)),
            )
            meshes.append(build_part(lamp, colour, material=material))
            meshes.append(build_part(np.concatenate(corner), INDICATOR, material=indicator))
    return meshes


def _build_plates(length: float, high: float) -> list[Mesh]:
    """Return the number plates below a height."""
    plate = (-0.26, 0.26), (high - 0.14, high - 0.02)
    return [build_part(_build_end_face(end, end * length / 2, *plate), PLATE) for end in (1, -1)]


def _build_end_face(end: int, x: float, y: tuple[float, float], z: tuple[float, float]) -> Float:
    """Return the triangles of an upright rectangle at x that faces ahead (end 1) or back (-1)."""
    low, high = min(y), max(y)
    quad = np.array(((x, low, z[0]), (x, high, z[0]), (x, high, z[1]), (x, low, z[1])))
    return build_quads(quad[None, ::end])


def _build_side_face(side: int, y: float, x: tuple[float, float], z: tuple[float, float]) -> Float:
    """Return the triangles of an upright rectangle at y that faces left (side 1) or right (-1)."""
    low, high = min(x), max(x)
    quad = np.array(((high, y, z[0]), (low, y, z[0]), (low, y, z[1]), (high, y, z[1])))
    return build_quads(quad[None, ::side])


def _build_wheels(axles: tuple[float, ...], width: float, radius: float, is_fine: bool) -> list[Mesh]:
    """Return tyres without their hidden inner side, and hubs."""
    half = width / 2 * 0.985
    corners = 12 if is_fine else 6
    meshes: list[Mesh] = []
    for x in axles:
        for side in (-1, 1):
            low, high = sorted((side * half, side * (half - TYRE_M)))
            tread, *discs = np.split(build_wheel(x, (low, high), radius, corners), (2 * corners, 3 * corners))
            meshes.append(build_part(np.concatenate((tread, discs[0 if side < 0 else 1])), RUBBER))
            if is_fine:
                hub = build_disc((x, side * width / 2, radius), 0.55 * radius, 8)
                meshes.append(build_part(hub if side < 0 else hub[:, ::-1], HUB))
    return meshes


def build_car(is_fine: bool) -> tuple[Mesh, Corner]:
    """Return a saloon car and its size."""
    length, width, height = size = 4.6, 1.85, 1.5
    waist, half = 0.88, width / 2
    cabin = build_frustum(
        ((-1.95, -half * 0.97, waist), (1.05, half * 0.97, waist)),
        ((-1.35, -half * 0.82, height - 0.04), (0.35, half * 0.82, height - 0.04)),
    )
    hood = build_frustum(
        ((-length / 2 + FACE_M, -half + FACE_M, 0.72), (length / 2 - FACE_M, half - FACE_M, 0.72)),
        ((-length / 2 + 0.15, -half * 0.94, waist), (length / 2 - 0.35, half * 0.94, waist - 0.06)),
    )
    third = build_block((-1.92, -0.3, waist + 0.02), (-1.82, 0.3, waist + 0.09))
    parts = [
        paint_mesh(build_centred((-length / 2 + FACE_M, 0.22), half - FACE_M, (length / 2 - FACE_M, 0.72))),
        paint_mesh(hood),
        build_part(build_centred((-length / 2, 0.26), half * 0.94, (length / 2 - FACE_M / 2, 0.56)), TRIM),
        build_part(cabin, GLASS),
        paint_mesh(build_centred((-1.36, height - 0.05), half * 0.83, (0.36, height))),
        build_part(third, BRAKE_LAMP, material=Material.BRAKE_LAMP),
    ]
    return _assemble(parts, size, (0.58, 0.72, 0.3), (-1.4, 1.4), 0.33, is_fine)


def build_van(is_fine: bool) -> tuple[Mesh, Corner]:
    """Return a van and its size."""
    length, width, height = size = 6.0, 2.0, 2.2
    half = width / 2
    nose = build_centred((1.6, 0.3), half - FACE_M, (length / 2 - FACE_M, 1.2))
    glass = build_frustum(
        ((1.6, -half * 0.96, 1.2), (length / 2 - 0.12, half * 0.96, 1.2)),
        ((1.6, -half * 0.92, height - 0.1), (2.0, half * 0.92, height - 0.1)),
    )
    rear = build_block((-length / 2, -half * 0.8, 1.35), (-length / 2 + FACE_M, half * 0.8, 1.95))
    parts = [
        paint_mesh(build_centred((-length / 2 + FACE_M, 0.3), half - FACE_M, (1.6, height))),
        paint_mesh(nose),
        build_part(glass, GLASS),
        build_part(rear, GLASS),
    ]
    return _assemble(parts, size, (0.7, 0.95, 0.2), (-1.9, 1.9), 0.36, is_fine)


def build_truck(is_fine: bool) -> tuple[Mesh, Corner]:
    """Return a truck and its size."""
    length, width, height = size = 9.0, 2.5, 3.4
    half = width / 2
    parts = [
        build_part(build_centred((-length / 2 + FACE_M, 1.05), half, (2.2, height)), CARGO),
        paint_mesh(build_centred((2.5, 0.5), half - FACE_M, (length / 2 - FACE_M, 2.9))),
        build_part(build_centred((length / 2 - 0.05, 1.7), half * 0.92, (length / 2, 2.6)), GLASS),
        build_part(build_centred((3.4, 1.75), half, (4.2, 2.5)), GLASS),
        build_part(build_centred((-length / 2 + FACE_M, 0.55), half * 0.4, (length / 2 - 0.3, 1.05)), TRIM),
        build_part(build_centred((-length / 2 + FACE_M, 0.65), half * 0.98, (-length / 2 + 0.3, 1.05)), TRIM),
    ]
    return _assemble(parts, size, (0.75, 1.0, 0.32), (-3.2, -2.0, 3.3), 0.5, is_fine)


def build_bus(is_fine: bool) -> tuple[Mesh, Corner]:
    """Return a bus and its size."""
    length, width, height = size = 12.0, 2.55, 3.4
    half = width / 2
    parts = [
        paint_mesh(build_centred((-length / 2 + FACE_M, 0.35), half - FACE_M, (length / 2 - FACE_M, height))),
        build_part(build_centred((-length / 2 + 0.4, 1.4), half, (length / 2 - 0.4, 2.6)), GLASS),
        build_part(build_centred((length / 2 - 0.05, 1.2), half * 0.94, (length / 2, 2.9)), GLASS),
        build_part(build_centred((-length / 2, 1.6), half * 0.8, (-length / 2 + 0.05, 2.6)), GLASS),
    ]
    return _assemble(parts, size, (0.6, 0.85, 0.32), (-3.4, 3.6), 0.5, is_fine)
