"""Simple solid models of road users, of our own making, in unit boxes: x and y from -0.5 to 0.5, z from 0 to 1.

A model is scaled to the box of a road user; it touches all sides of the box, so that an image shows an object as large
as the scorer takes it to be.
"""

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract.semantic_classes import SemanticClass
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind, RoadUsers
from mdrive_sumo.sensing.camera.meshes import (
    Colour,
    Corner,
    Material,
    Mesh,
    build_block,
    build_frustum,
    build_mesh,
    build_wheel,
    join_meshes,
)
from mdrive_sumo.sensing.lidar_world import TRUCK_LENGTH_M, VAN_LENGTH_M

GLASS: Colour = (38, 46, 56)
RUBBER: Colour = (24, 24, 26)
TRIM: Colour = (58, 60, 64)
HEADLAMP: Colour = (236, 236, 222)
TAIL_LAMP: Colour = (150, 22, 24)
INDICATOR: Colour = (214, 128, 30)
SKIN: Colour = (196, 148, 120)
TROUSERS: Colour = (52, 58, 82)
MOTORCYCLE_WIDTH_M, MOTORCYCLE_LENGTH_M = 1.2, 2.8
"""Vehicles below both are motorcycles."""
BUS_LENGTH_M, TRAILER_LENGTH_M = 10.0, 14.5
"""Vehicles between these lengths are drawn as buses: SUMO's frames do not tell trucks from buses."""


class RoadUserModel(IntEnum):
    """Which model a road user is drawn with."""

    CAR = 0
    VAN = 1
    TRUCK = 2
    BUS = 3
    MOTORCYCLE = 4
    CYCLIST = 5
    PEDESTRIAN = 6
    OBSTACLE = 7


def choose_models(boxes: RoadUsers) -> Int:
    """Return the `RoadUserModel` (N,) of every box."""
    length, width, kind = boxes.length, boxes.width, boxes.kind
    of_vehicles = np.select(
        (
            (length < MOTORCYCLE_LENGTH_M) & (width < MOTORCYCLE_WIDTH_M),
            length < VAN_LENGTH_M,
            length < TRUCK_LENGTH_M,
            (length >= BUS_LENGTH_M) & (length < TRAILER_LENGTH_M),
        ),
        (RoadUserModel.MOTORCYCLE, RoadUserModel.CAR, RoadUserModel.VAN, RoadUserModel.BUS),
        RoadUserModel.TRUCK,
    )
    others = (kind == Kind.PEDESTRIAN, kind == Kind.CYCLIST, kind == Kind.STATIC)
    models = (RoadUserModel.PEDESTRIAN, RoadUserModel.CYCLIST, RoadUserModel.OBSTACLE)
    return np.select(others, models, of_vehicles).astype(np.int64)


def _paint(triangles: Float, semantic: SemanticClass = SemanticClass.VEHICLE) -> Mesh:
    return build_mesh(triangles, (255, 255, 255), semantic, Material.PAINT)


def _part(triangles: Float, colour: Colour, semantic: SemanticClass = SemanticClass.VEHICLE) -> Mesh:
    return build_mesh(triangles, colour, semantic)


def _lamps(length: float, width: float, z: tuple[float, float], breadth: float = 0.32) -> list[Mesh]:
    """Return head lamps, tail lamps and indicators at the corners of a vehicle."""
    lamps: list[Mesh] = []
    for side in (-1.0, 1.0):
        outer, inner, end = side * width / 2 * 0.97, side * (width / 2 * 0.97 - breadth), side * width / 2
        low_y, high_y = min(outer, inner), max(outer, inner)
        front = build_block((length / 2 - 0.05, low_y, z[0]), (length / 2, high_y, z[1]))
        rear = build_block((-length / 2, low_y, z[0]), (-length / 2 + 0.05, high_y, z[1]))
        lamps.append(build_mesh(front, HEADLAMP, SemanticClass.VEHICLE, Material.HEADLAMP))
        lamps.append(build_mesh(rear, TAIL_LAMP, SemanticClass.VEHICLE, Material.TAIL_LAMP))
        for x in (length / 2 - 0.25, -length / 2 + 0.1):
            low, high = min(outer, end), max(outer, end)
            lamps.append(_part(build_block((x, low, z[0]), (x + 0.15, high, z[1])), INDICATOR))
    return lamps


def _wheels(places: tuple[float, ...], width: float, radius: float) -> list[Mesh]:
    half, tyre = width / 2 * 0.985, 0.22
    sides = ((-half, -half + tyre), (half - tyre, half))
    return [_part(build_wheel(x, side, radius), RUBBER) for x in places for side in sides]


def _build_car() -> tuple[Mesh, Corner]:
    length, width, height = 4.6, 1.85, 1.5
    waist = 0.88
    body = build_block((-length / 2 + 0.05, -width / 2, 0.22), (length / 2 - 0.05, width / 2, waist))
    bumper = build_block((-length / 2, -width / 2 * 0.92, 0.28), (length / 2, width / 2 * 0.92, 0.62))
    cabin = build_frustum(
        ((-1.95, -width / 2 * 0.97, waist), (1.05, width / 2 * 0.97, waist)),
        ((-1.35, -width / 2 * 0.82, height - 0.04), (0.35, width / 2 * 0.82, height - 0.04)),
    )
    roof = build_block((-1.36, -width / 2 * 0.83, height - 0.05), (0.36, width / 2 * 0.83, height))
    parts = [_paint(body), _part(bumper, TRIM), _part(cabin, GLASS), _paint(roof)]
    return join_meshes([*parts, *_lamps(length, width, (0.64, 0.8)), *_wheels((-1.4, 1.4), width, 0.33)]), (
        length,
        width,
        height,
    )


def _build_van() -> tuple[Mesh, Corner]:
    length, width, height = 6.0, 2.0, 2.2
    box = build_block((-length / 2, -width / 2, 0.3), (1.6, width / 2, height))
    nose = build_frustum(
        ((1.6, -width / 2, 0.3), (length / 2, width / 2, 0.3)),
        ((1.6, -width / 2, 1.2), (length / 2 - 0.1, width / 2, 1.2)),
    )
    glass = build_frustum(
        ((1.6, -width / 2 * 0.96, 1.2), (length / 2 - 0.12, width / 2 * 0.96, 1.2)),
        ((1.6, -width / 2 * 0.92, height - 0.1), (2.0, width / 2 * 0.92, height - 0.1)),
    )
    parts = [_paint(box), _paint(nose), _part(glass, GLASS)]
    return join_meshes([*parts, *_lamps(length, width, (0.7, 0.95)), *_wheels((-1.9, 1.9), width, 0.36)]), (
        length,
        width,
        height,
    )


def _build_truck() -> tuple[Mesh, Corner]:
    length, width, height = 9.0, 2.5, 3.4
    cargo = build_block((-length / 2, -width / 2, 0.9), (2.2, width / 2, height))
    cab = build_block((2.5, -width / 2, 0.5), (length / 2, width / 2, 2.9))
    screen = build_block((length / 2 - 0.02, -width / 2 * 0.92, 1.7), (length / 2, width / 2 * 0.92, 2.6))
    frame = build_block((-length / 2, -0.5, 0.55), (length / 2 - 0.3, 0.5, 0.95))
    parts = [_part(cargo, (206, 208, 210)), _paint(cab), _part(screen, GLASS), _part(frame, TRIM)]
    return join_meshes([*parts, *_lamps(length, width, (0.75, 1.0)), *_wheels((-3.2, -2.0, 3.3), width, 0.5)]), (
        length,
        width,
        height,
    )


def _build_bus() -> tuple[Mesh, Corner]:
    length, width, height = 12.0, 2.55, 3.4
    body = build_block((-length / 2, -width / 2 * 0.995, 0.35), (length / 2, width / 2 * 0.995, height))
    side = build_block((-length / 2 + 0.4, -width / 2, 1.4), (length / 2 - 0.4, width / 2, 2.6))
    screen = build_block((length / 2 - 0.02, -width / 2 * 0.94, 1.2), (length / 2, width / 2 * 0.94, 2.9))
    parts = [_paint(body), _part(side, GLASS), _part(screen, GLASS)]
    return join_meshes([*parts, *_lamps(length, width, (0.6, 0.85)), *_wheels((-3.4, 3.6), width, 0.5)]), (
        length,
        width,
        height,
    )


def _rider(x: float, seat: float, height: float, half: float) -> list[Mesh]:
    """Return a person who sits at x."""
    torso = build_block((x - 0.18, -half, seat), (x + 0.18, half, height - 0.28))
    head = build_block((x - 0.11, -0.1, height - 0.28), (x + 0.13, 0.1, height))
    legs = build_block((x - 0.05, -0.2, 0.35), (x + 0.35, 0.2, seat + 0.05))
    person = SemanticClass.PEDESTRIAN
    return [_paint(torso, person), _part(head, SKIN, person), _part(legs, TROUSERS, person)]


def _build_two_wheeler(radius: float, frame: float, rider_half: float) -> Mesh:
    """Return a bicycle or motorcycle with its rider: 1.8 m long, 0.6 m wide, 1.75 m high."""
    wheels = [_part(build_wheel(x, (-frame / 2, frame / 2), radius), RUBBER) for x in (-0.9 + radius, 0.9 - radius)]
    beam = _part(build_block((-0.6, -frame / 2, 0.4), (0.6, frame / 2, 0.75)), TRIM)
    bar = _part(build_block((0.5, -0.3, 0.95), (0.58, 0.3, 1.05)), TRIM)
    return join_meshes([*wheels, beam, bar, *_rider(-0.15, 0.85, 1.75, rider_half)])


def _build_pedestrian() -> tuple[Mesh, Corner]:
    size = (0.6, 0.6, 1.75)
    person = SemanticClass.PEDESTRIAN
    legs = [
        build_block((-0.12 + shift, low, 0.0), (0.12 + shift, low + 0.17, 0.85))
        for low, shift in ((-0.2, 0.18), (0.03, -0.18))
    ]
    torso = build_block((-0.16, -0.22, 0.82), (0.16, 0.22, 1.45))
    arms = [
        build_block((-0.08 + shift, low, 0.8), (0.08 + shift, low + 0.08, 1.42))
        for low, shift in ((-0.3, -0.22), (0.22, 0.22))
    ]
    head = build_block((-0.12, -0.1, 1.45), (0.12, 0.1, 1.75))
    parts = [_part(leg, TROUSERS, person) for leg in legs] + [_paint(part, person) for part in (torso, *arms)]
    return join_meshes([*parts, _part(head, SKIN, person)]), size


def _build_obstacle() -> tuple[Mesh, Corner]:
    block = build_block((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0))
    return build_mesh(block, (255, 255, 255), SemanticClass.STATIC, Material.STRIPES), (1.0, 1.0, 1.0)


def _to_unit(model: tuple[Mesh, Corner]) -> Mesh:
    """Return a model of a size [m] in the unit box; normals are those of the size, see the shaders."""
    mesh, size = model
    unit = mesh.copy()
    unit["position"] = mesh["position"] / np.array(size, dtype=np.float32)
    unit["normal"] = mesh["normal"] * np.array(size, dtype=np.float32)
    return unit


_TWO_WHEELER_M: Corner = (1.8, 0.6, 1.75)
MODELS: Mapping[RoadUserModel, Mesh] = MappingProxyType(
    {
        RoadUserModel.CAR: _to_unit(_build_car()),
        RoadUserModel.VAN: _to_unit(_build_van()),
        RoadUserModel.TRUCK: _to_unit(_build_truck()),
        RoadUserModel.BUS: _to_unit(_build_bus()),
        RoadUserModel.MOTORCYCLE: _to_unit((_build_two_wheeler(0.31, 0.24, 0.24), _TWO_WHEELER_M)),
        RoadUserModel.CYCLIST: _to_unit((_build_two_wheeler(0.35, 0.06, 0.2), _TWO_WHEELER_M)),
        RoadUserModel.PEDESTRIAN: _to_unit(_build_pedestrian()),
        RoadUserModel.OBSTACLE: _to_unit(_build_obstacle()),
    }
)
"""The mesh of every model in its unit box; a normal (nx, ny, nz) in metres becomes n / size of the road user's box."""
