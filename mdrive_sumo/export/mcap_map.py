"""MCAP: the map of a recording as scene entities that last from tick 0 on."""

import numpy as np
import shapely
from foxglove.messages import (
    Color,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.export.lane_bounds import compute_bounds, compute_outline
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.sensing.lidar_world import BUILDING_M

ROAD, BOUND, ROUTE, ZEBRA = (0.22, 0.23, 0.25), (0.80, 0.80, 0.80), (0.20, 0.60, 0.95), (0.85, 0.85, 0.80)
BUILDING = (0.55, 0.50, 0.45)
LINE_M = 0.12
"""Thickness of lines [m], as of a road marking."""
ROAD_Z, ZEBRA_Z, LINE_Z = -0.02, -0.01, 0.0
"""Heights [m] at which surfaces do not flicker through each other."""


def build_map_entities(recording: ScoredRecording) -> list[SceneEntity]:
    """Return roads, lane bounds, crossings, buildings and the routes of the CAVs."""
    roads = recording.roads
    bounds = [line for lane in roads.driving if not lane.junction for line in compute_bounds(lane)]
    crossings = [
        shapely.get_coordinates(shapely.buffer(shapely.LineString(line), width / 2, cap_style="flat"))
        for line, width in roads.crossings
    ]
    routes = [ego.xy for ego in recording.scenario.egos]
    return [
        _build_entity("roads", surfaces=_triangulate([compute_outline(lane) for lane in roads.driving], ROAD_Z, ROAD)),
        _build_entity("crossings", surfaces=_triangulate(crossings, ZEBRA_Z, ZEBRA)),
        _build_entity("bounds", lines=[_build_line(line, LINE_Z, BOUND) for line in bounds]),
        _build_entity("routes", lines=[_build_line(line, LINE_Z, ROUTE) for line in routes]),
        _build_entity(
            "buildings",
            lines=[
                _build_line(np.concatenate((one.outline, one.outline[:1])), height, BUILDING)
                for one in roads.buildings
                for height in (LINE_Z, BUILDING_M)
            ],
            surfaces=_triangulate([one.outline for one in roads.buildings], BUILDING_M, BUILDING),
        ),
    ]


def _build_entity(
    name: str, lines: list[LinePrimitive] | None = None, surfaces: TriangleListPrimitive | None = None
) -> SceneEntity:
    return SceneEntity(
        timestamp=Timestamp(sec=0, nsec=0),
        frame_id="world",
        id=f"map/{name}",
        lines=lines or [],
        triangles=[surfaces] if surfaces is not None else [],
    )


def _build_line(xy: Float, height: float, color: tuple[float, float, float]) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineStrip,
        pose=_origin(),
        thickness=LINE_M,
        points=[Point3(x=x, y=y, z=height) for x, y in xy.tolist()],
        color=_opaque(color),
    )


def _triangulate(
    outlines: list[Float], height: float, color: tuple[float, float, float]
) -> TriangleListPrimitive | None:
    """Return the areas of the outlines as triangles; None without any."""
    points: list[Point3] = []
    for outline in outlines:
        area = shapely.make_valid(shapely.Polygon(outline))
        for triangle in shapely.constrained_delaunay_triangles(area).geoms:
            corners = shapely.get_coordinates(triangle)[:3]
            points += [Point3(x=x, y=y, z=height) for x, y in corners.tolist()]
    return TriangleListPrimitive(pose=_origin(), points=points, color=_opaque(color)) if points else None


def _origin() -> Pose:
    return Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))


def _opaque(color: tuple[float, float, float]) -> Color:
    return Color(r=color[0], g=color[1], b=color[2], a=1.0)
