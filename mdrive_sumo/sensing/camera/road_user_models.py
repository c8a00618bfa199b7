"""Simple solid models of road users, of our own making, in unit boxes: x and y from -0.5 to 0.5, z from 0 to 1.

A model is scaled to the box of a road user; it touches all sides of the box, so that an image shows an object as large
as the scorer takes it to be.
"""

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract.sensors import SemanticClass
from mdrive_sumo.core.geometry import Int
from mdrive_sumo.core.state import Kind, RoadUsers
from mdrive_sumo.sensing.camera.meshes import (
    Colour,
    Corner,
    Material,
    Mesh,
    build_block,
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
    parts = [build_part(leg, TROUSERS, person) for leg in legs] + [paint_mesh(part, person) for part in (torso, *arms)]
    return join_meshes([*parts, build_part(head, SKIN, person)]), size


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
