"""The scene of a network for a browser: the meshes, models and light of the cameras as one compressed block.

`static/view_3d.js` draws it. One builder serves both renderers: what stands still comes from
`sensing.camera.static_scene`, road users from `road_user_models`, colours of sky and sun from `lighting`.
"""

import gzip
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.contract.camera_rigs import build_camera_rig
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind, RoadUsers
from mdrive_sumo.report.map_view import find_area
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.sensing.camera.camera_model import FAR_PLANE_M, NEAR_PLANE_M, VIEW_M
from mdrive_sumo.sensing.camera.camera_renderer import TERRAIN
from mdrive_sumo.sensing.camera.instances import (
    FAR_M_OF_FOCAL,
    LAMP,
    LAMP_M,
    LIGHT_OF_LETTER,
    choose_paint,
)
from mdrive_sumo.sensing.camera.lighting import LIGHT_OF_WEATHER, LIGHTS
from mdrive_sumo.sensing.camera.meshes import Colour, Material, Mesh, join_meshes
from mdrive_sumo.sensing.camera.road_user_models import FAR_MODELS, MODELS, RoadUserModel, choose_models
from mdrive_sumo.sensing.camera.static_scene import SignalLamps, build_scene_meshes
from mdrive_sumo.sensing.lidar_world import assume_heights

CELL_M = 64.0
"""[m] Side of the grid cells by which points are grouped before the area around them is computed."""
STEPS_PER_M = 100
"""Vertices of the static scene are rounded to 1 cm."""
STEPS_OF_UNIT = 10_000
"""Vertices of models are rounded to this part of their box: 1.2 mm of a bus."""


class RoadUserLook(NamedTuple):
    """How a road user is drawn, as cameras draw it."""

    model: str
    """Name of its `RoadUserModel` in lower case."""
    paint: Colour
    height: float
    """[m]"""


def describe_road_user(name: str, kind: Kind, length: float, width: float) -> RoadUserLook:
    """Return the model, the colour and the height of a road user with an id and a size [m]."""
    zero, size = np.zeros(1), (np.array([length]), np.array([width]))
    boxes = RoadUsers((name,), np.array([kind], dtype=np.uint8), zero, zero, zero, zero, *size)
    model = RoadUserModel(int(choose_models(boxes)[0]))
    return RoadUserLook(model.name.lower(), choose_paint(name), float(assume_heights(boxes.kind, boxes.length)[0]))


def find_scene_area(points: Float, margin_m: float = VIEW_M) -> BaseGeometry:
    """Return the area within a margin [m] of points (N, 2) [m]; the default is as far as cameras see."""
    return find_area(points, margin_m, CELL_M)


def pack_scene(
    roads: RoadMap, area: BaseGeometry, weather: WeatherName = "default", origin: Sequence[float] | None = None
) -> bytes:
    """Return what stands still in an area, the models of road users and the lights, for `decodeScene` of the page.

    The block is a gzip stream of a JSON header and int32 tables. Vertices are relative to `origin` (x, y) [m], None:
    the middle of the area, rounded to metres; the header names it. The same input gives the same bytes.
    """
    middle = shapely.get_coordinates(area.centroid)[0].round().tolist()
    x, y = (float(value) for value in (middle if origin is None else origin))
    mesh, lamps = build_scene_meshes(roads, area, np.array((x, y, 0.0)))
    tables = _tabulate_mesh(mesh, STEPS_PER_M)
    header = {
        "origin": [x, y],
        "light": LIGHT_OF_WEATHER[weather],
        "lights": {name: asdict(light) for name, light in LIGHTS.items()},
        "planes_m": [NEAR_PLANE_M, FAR_PLANE_M],
        "view_m": VIEW_M,
        "far_m_of_focal": FAR_M_OF_FOCAL,
        "terrain": TERRAIN,
        "four": [{"id": spec.id, **spec.options} for spec in build_camera_rig("hitl")],
        "materials": {material.name.lower(): material.value for material in Material},
        "steps_per_m": STEPS_PER_M,
        "parts": tables.parts,
        "lamps": _describe_lamps(lamps),
        "models": _pack_models(),
    }
    return pack_tables(header, {"vertices": tables.vertices, "corners": tables.corners, **_model_tables()})


def pack_tables(header: Mapping[str, Any], tables: Mapping[str, Any]) -> bytes:
    """Return gzip of the length of the header as uint32, the header, and int32 tables (..., T) as steps along T."""
    shapes = [(name, table.shape[-1], table.size) for name, table in tables.items()]
    head = json.dumps({**header, "tables": shapes}, separators=(",", ":"), allow_nan=False, default=str).encode()
    body = b"".join(map(_encode_steps, tables.values()))
    return gzip.compress(len(head).to_bytes(4, "little") + head + body, compresslevel=9, mtime=0)


def _encode_steps(table: Any) -> bytes:
    """Rows (..., T) as their first value and steps, little-endian int32: what changes smoothly packs well."""
    return np.diff(table.astype("<i4"), axis=-1, prepend=np.int32(0)).astype("<i4").tobytes()


class _MeshTables(NamedTuple):
    parts: list[list[int]]
    """Red, green, blue, material, layer of the ground, number of vertices, and number of corners of triangles."""
    vertices: Int
    """(3, V) x, y, z in steps, part by part, in the order of their first use."""
    corners: Int
    """(C,) of triangles: how far back of the newest vertex of its part so far the vertex lies, 0: a new one."""


def _tabulate_mesh(mesh: Mesh, steps: int) -> _MeshTables:
    """Return a mesh by parts of one colour, material and layer, which keep the order of their triangles."""
    looks = np.column_stack((mesh["colour"][:, :3], mesh["kind"][:, 1:3])).astype(np.int64)
    position = np.rint(mesh["position"].astype(np.float64) * steps).astype(np.int64)
    parts: list[list[int]] = []
    vertices, corners = [np.zeros((3, 0), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for rows in _list_parts(looks):
        points, back = _index_vertices(position[rows])
        parts.append([*looks[rows[0]].tolist(), len(points), len(back)])
        vertices.append(points.T)
        corners.append(back)
    return _MeshTables(parts, np.concatenate(vertices, axis=1), np.concatenate(corners))


def _list_parts(looks: Int) -> Iterator[Int]:
    """Yield the rows of each part, in the order of their first rows: solids first, then the ground from the top."""
    if not len(looks):
        return
    _, first, part = np.unique(looks, axis=0, return_index=True, return_inverse=True)
    for number in np.argsort(first).tolist():
        yield np.flatnonzero(part.reshape(-1) == number)


def _index_vertices(corners: Int) -> tuple[Int, Int]:
    """Return the distinct vertices (V, 3) in the order of their first use, and how far back each corner's lies."""
    points, first, index = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(points), dtype=np.int64)
    rank[order] = np.arange(len(points))
    index = rank[index.reshape(-1)]
    newest = np.maximum.accumulate(np.concatenate(([-1], index[:-1])))
    return points[order], newest + 1 - index


def _describe_lamps(lamps: SignalLamps) -> dict[str, Any]:
    """Return the lamps of traffic lights: places [m], directions, and what SUMO's letters look like."""
    return {
        "names": lamps.names,
        "place": np.round(lamps.place, 2).tolist(),
        "turn": np.round(lamps.turn, 4).tolist(),
        "size": LAMP_M,
        "of_letter": {letter: [height, *colour] for letter, (height, colour) in LIGHT_OF_LETTER.items()},
    }


_LAMP_MODEL = "lamp"


@lru_cache(maxsize=1)
def _tabulate_models() -> tuple[tuple[str, _MeshTables], ...]:
    meshes = {model.name.lower(): mesh for model, mesh in MODELS.items()}
    far = {f"far {model.name.lower()}": mesh for model, mesh in FAR_MODELS.items()}
    every = {**meshes, **far, _LAMP_MODEL: LAMP}
    return tuple((name, _tabulate_mesh(join_meshes([mesh]), STEPS_OF_UNIT)) for name, mesh in every.items())


def _pack_models() -> dict[str, Any]:
    """Return the parts of each model in its unit box; far ones have simpler wheels."""
    return {"steps": STEPS_OF_UNIT, "parts": {name: tables.parts for name, tables in _tabulate_models()}}


def _model_tables() -> dict[str, Int]:
    models = [tables for _, tables in _tabulate_models()]
    return {
        "model_vertices": np.concatenate([tables.vertices for tables in models], axis=1),
        "model_corners": np.concatenate([tables.corners for tables in models]),
    }
