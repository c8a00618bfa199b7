"""Simple solid models of road users, of our own making, in unit boxes: x and y from -0.5 to 0.5, z from 0 to 1.

A model is scaled to the box of a road user; it touches all sides of the box, so that an image shows an object as large
as the scorer takes it to be.
"""

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract.sensors import SemanticClass
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
from mdrive_sumo.sensing.camera.vehicle_models import (
    HEADLAMP,
    RUBBER,
    TAIL_LAMP,
    TRIM,
    build_bus,
    build_car,
    build_part,
    build_truck,
    build_van,
    paint_mesh,
)
from mdrive_sumo.sensing.lidar_world import TRUCK_LENGTH_M, VAN_LENGTH_M

SKIN: Colour = (196, 148, 120)
TROUSERS: Colour = (52, 58, 82)
HAIR: Colour = (58, 44, 36)
SHOES: Colour = (40, 36, 34)
MOTORCYCLE_WIDTH_M, MOTORCYCLE_LENGTH_M = 1.2, 2.8
"""Vehicles below both are motorcycles."""
BUS_LENGTH_M, TRAILER_LENGTH_M = 10.0, 14.5
"""Vehicles between these lengths are drawn as buses: SUMO's frames do not tell trucks from buses."""


class RoadUserModel(IntEnum):
    """Which model a road user is drawn with; labels of training data hold the numbers."""

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


def _rider(x: float, seat: float, height: float, half: float) -> list[Mesh]:
    """Return a person who sits at x."""
    torso = build_block((x - 0.18, -half, seat), (x + 0.18, half, height - 0.28))
    head = build_block((x - 0.11, -0.1, height - 0.28), (x + 0.13, 0.1, height))
    legs = build_block((x - 0.05, -0.2, 0.35), (x + 0.35, 0.2, seat + 0.05))
    person = SemanticClass.PEDESTRIAN
    return [paint_mesh(torso, person), build_part(head, SKIN, person), build_part(legs, TROUSERS, person)]


def _build_two_wheeler(radius: float, frame: float, rider_half: float) -> Mesh:
    """Return a bicycle or motorcycle with its rider: 1.8 m long, 0.6 m wide, 1.75 m high."""
    wheels = [
        build_part(build_wheel(x, (-frame / 2, frame / 2), radius), RUBBER) for x in (-0.9 + radius, 0.9 - radius)
    ]
    lamps = (
        build_part(build_block((0.6, -0.08, 0.78), (0.68, 0.08, 0.92)), HEADLAMP, material=Material.HEADLAMP),
        build_part(build_block((-0.72, -0.06, 0.6), (-0.66, 0.06, 0.7)), TAIL_LAMP, material=Material.TAIL_LAMP),
    )
    beam = build_part(build_block((-0.66, -frame / 2, 0.4), (0.6, frame / 2, 0.75)), TRIM)
    bar = build_part(build_block((0.5, -0.3, 0.95), (0.58, 0.3, 1.05)), TRIM)
    return join_meshes([*wheels, *lamps, beam, bar, *_rider(-0.15, 0.85, 1.75, rider_half)])


class Limb(IntEnum):
    """What moves when a person walks; the numbers are those of the shaders, 0 is the rest of a body."""

    LEFT_LEG = 1
    RIGHT_LEG = 2
    LEFT_ARM = 3
    RIGHT_ARM = 4


def _build_limb(
    limb: Limb, low: tuple[float, float, float], high: tuple[float, float, float], middle_y: float
) -> tuple[Limb, Float]:
    """Return a limb from its lower end (height, half its depth, half its width) to its upper end [m]."""
    (z0, x0, y0), (z1, x1, y1) = low, high
    y = middle_y
    return limb, build_frustum(((-x0, y - y0, z0), (x0, y + y0, z0)), ((-x1, y - y1, z1), (x1, y + y1, z1)))


def _build_pedestrian() -> tuple[Mesh, Corner]:
    """Return a standing person, whose limbs the shaders move."""
    size = (0.6, 0.6, 1.75)
    person = SemanticClass.PEDESTRIAN
    torso = [
        build_frustum(((-0.12, -0.17, 0.84), (0.12, 0.17, 0.84)), ((-0.11, -0.16, 1.08), (0.11, 0.16, 1.08))),
        build_frustum(((-0.11, -0.16, 1.08), (0.11, 0.16, 1.08)), ((-0.12, -0.22, 1.42), (0.12, 0.22, 1.42))),
        build_frustum(((-0.12, -0.22, 1.42), (0.12, 0.22, 1.42)), ((-0.06, -0.09, 1.5), (0.06, 0.09, 1.5))),
    ]
    head = build_frustum(((-0.08, -0.07, 1.47), (0.09, 0.07, 1.47)), ((-0.1, -0.085, 1.66), (0.1, 0.085, 1.66)))
    hair = build_frustum(((-0.115, -0.09, 1.62), (0.09, 0.09, 1.62)), ((-0.08, -0.07, 1.75), (0.06, 0.07, 1.75)))
    meshes = [paint_mesh(part, person) for part in torso]
    meshes += [build_part(head, SKIN, person), build_part(hair, HAIR, person)]
    for leg, arm, side in ((Limb.LEFT_LEG, Limb.LEFT_ARM, 1), (Limb.RIGHT_LEG, Limb.RIGHT_ARM, -1)):
        parts = (
            (*_build_limb(leg, (0.06, 0.06, 0.06), (0.86, 0.11, 0.085), side * 0.095), TROUSERS),
            (leg, build_block((-0.07, side * 0.1 - 0.05, 0.0), (0.19, side * 0.1 + 0.05, 0.09)), SHOES),
            (*_build_limb(arm, (0.88, 0.045, 0.04), (1.42, 0.06, 0.05), side * 0.26), None),
            (*_build_limb(arm, (0.76, 0.04, 0.03), (0.88, 0.045, 0.04), side * 0.26), SKIN),
        )
        for limb, triangles, colour in parts:
            mesh = paint_mesh(triangles, person) if colour is None else build_part(triangles, colour, person)
            mesh["kind"][:, 3] = limb
            meshes.append(mesh)
    return join_meshes(meshes), size


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
"""[m] Length, width and height with its rider."""
_VEHICLES = {
    RoadUserModel.CAR: build_car,
    RoadUserModel.VAN: build_van,
    RoadUserModel.TRUCK: build_truck,
    RoadUserModel.BUS: build_bus,
}
MODELS: Mapping[RoadUserModel, Mesh] = MappingProxyType(
    {
        **{model: _to_unit(build(True)) for model, build in _VEHICLES.items()},
        RoadUserModel.MOTORCYCLE: _to_unit((_build_two_wheeler(0.31, 0.24, 0.24), _TWO_WHEELER_M)),
        RoadUserModel.CYCLIST: _to_unit((_build_two_wheeler(0.35, 0.06, 0.2), _TWO_WHEELER_M)),
        RoadUserModel.PEDESTRIAN: _to_unit(_build_pedestrian()),
        RoadUserModel.OBSTACLE: _to_unit(_build_obstacle()),
    }
)
"""The mesh of every model in its unit box; a normal (nx, ny, nz) in metres becomes n / size of the road user's box."""
FAR_MODELS: Mapping[RoadUserModel, Mesh] = MappingProxyType(
    {model: _to_unit(build(False)) for model, build in _VEHICLES.items()}
)
"""Vehicles with simpler wheels, for those whose wheels cover few pixels."""

_BLOCK = build_block((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0))
_CAR_SHADOW = (
    build_block((-0.5, -0.5, 0.1), (0.5, 0.5, 0.58)),
    build_frustum(((-0.42, -0.48, 0.55), (0.23, 0.48, 0.55)), ((-0.29, -0.41, 1.0), (0.08, 0.41, 1.0))),
)
_RIDER_SHADOW = build_block((-0.5, -0.08, 0.0), (0.5, 0.08, 0.5)), build_block((-0.2, -0.33, 0.4), (0.05, 0.33, 1.0))
SHADOW_MODELS: Mapping[RoadUserModel, Float] = MappingProxyType(
    {
        **dict.fromkeys(RoadUserModel, _BLOCK),
        RoadUserModel.CAR: np.concatenate(_CAR_SHADOW),
        RoadUserModel.MOTORCYCLE: np.concatenate(_RIDER_SHADOW),
        RoadUserModel.CYCLIST: np.concatenate(_RIDER_SHADOW),
        RoadUserModel.PEDESTRIAN: build_block((-0.25, -0.35, 0.0), (0.25, 0.35, 1.0)),
    }
)
"""Triangles (T, 3, 3) in the unit box of every model that throw its shadow: few, for a shadow shows little."""
