"""The packed scene of the 3-D view: what it carries, and that it is what cameras draw."""

import gzip
import json
from typing import Any

import numpy as np
import pytest
import shapely
from testing.viewer_crossing import crossing

from mdrive_sumo.core.state import Kind
from mdrive_sumo.report.scene_3d import describe_road_user, find_scene_area, pack_scene
from mdrive_sumo.sensing.camera.instances import MESHES
from mdrive_sumo.sensing.camera.static_scene import build_scene_meshes

AREA = shapely.box(-120.0, -120.0, 120.0, 120.0)


def unpack(packed: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and tables, read independently of the page's script."""
    content = gzip.decompress(packed)
    size = int.from_bytes(content[:4], "little")
    header, offset, tables = json.loads(content[4 : 4 + size]), 4 + size, {}
    for name, columns, count in header["tables"]:
        steps = np.frombuffer(content, "<i4", count, offset).reshape(count // max(columns, 1), columns)
        tables[name], offset = np.cumsum(steps, axis=1), offset + 4 * count
    assert offset == len(content)
    return header, tables


def list_corners(parts: list[list[int]], vertices: Any, corners: Any) -> list[tuple[tuple[int, ...], Any]]:
    """Each part's colour, material and layer, and the corners (C, 3) of its triangles, in steps."""
    listed, first, at = [], 0, 0
    for *look, count, size in parts:
        newest, rows = -1, []
        for back in corners[0, at : at + size].tolist():
            rows.append(first + newest + 1 - back)
            newest += back == 0
        assert newest == count - 1
        listed.append((tuple(look), vertices[:, rows].T))
        first, at = first + count, at + size
    return listed


@pytest.mark.slow
def test_the_scene_is_what_cameras_draw() -> None:
    header, tables = unpack(pack_scene(crossing(), AREA, "rain", (30.0, -20.0)))
    mesh, lamps = build_scene_meshes(crossing(), AREA, np.array((30.0, -20.0, 0.0)))
    parts = list_corners(header["parts"], tables["vertices"], tables["corners"])
    packed = {(*look, *row) for look, rows in parts for row in rows.tolist()}
    drawn = np.column_stack(
        (mesh["colour"][:, :3], mesh["kind"][:, 1:3], np.rint(mesh["position"].astype(float) * 100))
    )
    assert packed == {tuple(row) for row in drawn.astype(int).tolist()}
    assert sum(len(rows) for _, rows in parts) == len(mesh)
    assert header["origin"] == [30.0, -20.0] and header["light"] == "rain"
    assert header["lamps"]["names"] == list(lamps.names) and len(lamps.names) > 4


def test_models_are_those_of_cameras() -> None:
    header, tables = unpack(pack_scene(crossing(), AREA))
    counts = header["models"]["parts"]
    assert sum(part[-1] for parts in counts.values() for part in parts) == sum(map(len, MESHES))
    parts = list_corners(
        [part for parts in counts.values() for part in parts], tables["model_vertices"], tables["model_corners"]
    )
    assert np.abs(np.concatenate([rows for _, rows in parts])).max() <= header["models"]["steps"]


@pytest.mark.slow
def test_the_same_scene_has_the_same_bytes() -> None:
    assert pack_scene(crossing(), AREA) == pack_scene(crossing(), AREA)


def test_an_area_without_anything_is_a_scene() -> None:
    header, tables = unpack(pack_scene(crossing(), shapely.box(9e4, 9e4, 9.1e4, 9.1e4)))
    assert header["parts"] == [] and tables["vertices"].size == 0 and header["lamps"]["names"] == []


def test_the_area_reaches_as_far_as_cameras_see() -> None:
    points = np.array(((0.0, 0.0), (500.0, 3.0)))
    area = find_scene_area(points, 400.0)
    assert all(area.contains(shapely.Point(x, y).buffer(395.0)) for x, y in points.tolist())


@pytest.mark.parametrize(
    ("kind", "size", "model", "height"),
    [
        (Kind.VEHICLE, (4.9, 1.9), "car", 1.5),
        (Kind.VEHICLE, (12.0, 2.5), "bus", 3.4),
        (Kind.PEDESTRIAN, (0.5, 0.5), "pedestrian", 1.75),
        (Kind.CYCLIST, (1.8, 0.6), "cyclist", 1.75),
        (Kind.STATIC, (1.0, 1.0), "obstacle", 1.0),
    ],
)
def test_road_users_look_as_in_images(kind: Kind, size: tuple[float, float], model: str, height: float) -> None:
    look = describe_road_user("veh_1", kind, *size)
    assert (look.model, look.height) == (model, height)
    assert look.paint == describe_road_user("veh_1", kind, *size).paint
