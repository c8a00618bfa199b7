"""MCAP: one log per recording for Foxglove: 3-D scene, transforms of the CAVs, messages, events, controls, signals.

Foxglove's message schemas (https://docs.foxglove.dev/docs/sdk/schemas) in protobuf, our own topics in JSON. Frame
`world` is the network's: metres, x to the right, y up, z = 0 the ground. Time is that of the episode: tick 0 is 0 ns.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
import shapely
from foxglove.channels import FrameTransformsChannel, LogChannel, SceneUpdateChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import (
    Color,
    CubePrimitive,
    Duration,
    FrameTransform,
    FrameTransforms,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Log,
    LogLevel,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.export.export_tables import EXPORT_TABLES
from mdrive_sumo.export.lane_assignment import compute_bounds, compute_outline
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.sensing.lidar_world import BUILDING_M

WORLD = "world"
TICK_NS = 1_000_000_000 // TICKS_PER_SECOND
CAV_COLORS = ((0.00, 0.45, 0.70), (0.90, 0.62, 0.00), (0.00, 0.62, 0.45), (0.80, 0.47, 0.65), (0.34, 0.71, 0.91))
"""Okabe and Ito's colours, which colour-blind people tell apart; they repeat after five CAVs."""
COLOR_BY_KIND = {
    Kind.VEHICLE: (0.55, 0.57, 0.60),
    Kind.PEDESTRIAN: (0.84, 0.37, 0.00),
    Kind.CYCLIST: (0.94, 0.89, 0.26),
    Kind.STATIC: (0.35, 0.35, 0.35),
}
"""Red, green and blue from 0 to 1, chosen muted: only CAVs are bright."""
JSON_TOPICS = {"/v2x/messages": "messages", "/signals": "signals"}
"""Topic -> the table (`export_tables`) whose rows are its messages, each in its tick."""
ROAD, BOUND, ROUTE, ZEBRA = (0.22, 0.23, 0.25), (0.80, 0.80, 0.80), (0.20, 0.60, 0.95), (0.85, 0.85, 0.80)
BUILDING = (0.55, 0.50, 0.45)
LINE_M = 0.12
"""Thickness of lines [m], as of a road marking."""
ROAD_Z, ZEBRA_Z, LINE_Z = -0.02, -0.01, 0.0
"""Heights [m] at which surfaces do not flicker through each other."""


def write_mcap(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write SCENARIO.mcap per recording."""
    for recording in recordings:
        _write_log(recording, folder / f"{recording.name}.mcap")


def _write_log(recording: ScoredRecording, path: Path) -> None:
    context = foxglove.Context()  # of its own: no other log of this process reaches this file
    options = MCAPWriteOptions(compression_threads=0)
    with foxglove.open_mcap(path, context=context, writer_options=options) as writer:
        writer.write_metadata("mdrive-sumo", _describe_run(recording))
        SceneUpdateChannel("/map", context=context).log(SceneUpdate(entities=build_map_entities(recording)), log_time=0)
        scene = SceneUpdateChannel("/scene", context=context)
        frames = FrameTransformsChannel("/tf", context=context)
        for tick in range(recording.record.ticks):
            scene.log(_build_scene(recording, tick), log_time=tick * TICK_NS)
            frames.log(_build_transforms(recording, tick), log_time=tick * TICK_NS)
        _log_events(recording, context)
        _log_tables(recording, context)
        _log_cavs(recording, context)


def _describe_run(recording: ScoredRecording) -> dict[str, str]:
    """Return what identifies the episode, as texts."""
    result = recording.result
    scores = {name: f"{getattr(result, name):g}" for name in ("ds", "sr", "rc", "ip")}
    about = {str(key): str(value) for key, value in recording.record.about.items()}
    network = recording.roads.name
    return {**about, "scenario": result.id, "network": network, "digest": recording.record.digest, **scores}


def _build_scene(recording: ScoredRecording, tick: int) -> SceneUpdate:
    """Return the boxes of a tick, and the deletion of those that have left since the tick before."""
    valid = recording.record.valid
    gone = np.flatnonzero(valid[tick - 1] & ~valid[tick]).tolist() if tick else []
    ids = recording.record.ids
    return SceneUpdate(
        deletions=[SceneEntityDeletion(timestamp=_stamp(tick), id=ids[n]) for n in gone],
        entities=[_build_entity(recording, tick, n) for n in np.flatnonzero(valid[tick]).tolist()],
    )


def _build_entity(recording: ScoredRecording, tick: int, n: int) -> SceneEntity:
    record = recording.record
    height, id_ = float(recording.heights[n]), record.ids[n]
    x, y, speed = (float(values[tick, n]) for values in (record.x, record.y, record.speed))
    is_cav = n < record.egos
    color = CAV_COLORS[n % len(CAV_COLORS)] if is_cav else COLOR_BY_KIND[Kind(int(record.kind[n]))]
    box = CubePrimitive(
        pose=Pose(position=Vector3(x=x, y=y, z=height / 2), orientation=_turn(float(record.yaw[tick, n]))),
        size=Vector3(x=float(record.length[n]), y=float(record.width[n]), z=height),
        color=Color(r=color[0], g=color[1], b=color[2], a=1.0),
    )
    label = TextPrimitive(
        pose=Pose(position=Vector3(x=x, y=y, z=height + 1.0), orientation=_turn(0.0)),
        billboard=True,
        font_size=1.2,
        color=Color(r=1.0, g=1.0, b=1.0, a=1.0),
        text=f"{id_}  {speed:.1f} m/s",
    )
    facts = {"kind": Kind(int(record.kind[n])).name.lower(), "speed": f"{speed:.3f}", "is_cav": str(is_cav).lower()}
    return SceneEntity(
        timestamp=_stamp(tick),
        frame_id=WORLD,
        id=id_,
        lifetime=Duration(sec=0, nsec=0),
        metadata=[KeyValuePair(key=key, value=value) for key, value in facts.items()],
        cubes=[box],
        texts=[label] if is_cav else [],
    )


def _build_transforms(recording: ScoredRecording, tick: int) -> FrameTransforms:
    """Return the frame of every CAV: its box centre on the ground, x ahead."""
    record = recording.record
    present = np.flatnonzero(record.valid[tick, : record.egos]).tolist()
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=_stamp(tick),
                parent_frame_id=WORLD,
                child_frame_id=f"cav/{record.ids[n]}",
                translation=Vector3(x=float(record.x[tick, n]), y=float(record.y[tick, n]), z=0.0),
                rotation=_turn(float(record.yaw[tick, n])),
            )
            for n in present
        ]
    )


def _log_events(recording: ScoredRecording, context: foxglove.Context) -> None:
    """Log infractions as warnings, and how CAVs ended."""
    channel = LogChannel("/events", context=context)
    for row in _list_rows(recording, "events"):
        level = LogLevel.Warning if row["factor"] < 1.0 else LogLevel.Info
        partner = f" with {row['other']}" if row["other"] else ""
        text = f"CAV {row['cav']}: {row['event']}{partner} {row['text']}".rstrip()
        log = Log(timestamp=_stamp(row["tick"]), level=level, message=text, name=row["cav"])
        channel.log(log, log_time=row["tick"] * TICK_NS)


def _log_tables(recording: ScoredRecording, context: foxglove.Context) -> None:
    for topic, name in JSON_TOPICS.items():
        table = next(candidate for candidate in EXPORT_TABLES if candidate.name == name)
        fields = {column.name: {"type": column.type, "description": column.description} for column in table.columns}
        schema = {"type": "object", "title": f"mdrive_sumo.{name}", "properties": fields}
        channel = foxglove.Channel(topic, schema=schema, context=context)
        for row in _list_rows(recording, name):
            channel.log(row, log_time=row["tick"] * TICK_NS)


def _log_cavs(recording: ScoredRecording, context: foxglove.Context) -> None:
    """Log speed [m/s] and controls of every CAV, for plots."""
    record = recording.record
    names = ("speed", "throttle", "brake", "steer")
    schema = {
        "type": "object",
        "title": "mdrive_sumo.cav",
        "properties": {name: {"type": "number"} for name in names},
    }
    for n, ego in enumerate(record.ego_ids):
        channel = foxglove.Channel(f"/cav/{ego}", schema=schema, context=context)
        for tick in np.flatnonzero(record.valid[:, n]).tolist():
            values = (record.speed[tick, n], *record.control_values[tick, n])
            message = {name: round(float(value), 4) for name, value in zip(names, values, strict=True)}
            channel.log(message, log_time=tick * TICK_NS)


def _list_rows(recording: ScoredRecording, name: str) -> Iterator[dict[str, Any]]:
    table = next(candidate for candidate in EXPORT_TABLES if candidate.name == name)
    columns = table.build_rows(recording)
    return (dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True))


def _stamp(tick: int) -> Timestamp:
    seconds, rest = divmod(tick, TICKS_PER_SECOND)
    return Timestamp(sec=seconds, nsec=rest * TICK_NS)


def _turn(yaw: float) -> Quaternion:
    """Return a rotation about the vertical axis."""
    cos, sin = portable.cos_sin(yaw / 2)
    return Quaternion(x=0.0, y=0.0, z=sin, w=cos)


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
        _build_map_entity(
            "roads", surfaces=_triangulate([compute_outline(lane) for lane in roads.driving], ROAD_Z, ROAD)
        ),
        _build_map_entity("crossings", surfaces=_triangulate(crossings, ZEBRA_Z, ZEBRA)),
        _build_map_entity("bounds", lines=[_build_line(line, LINE_Z, BOUND) for line in bounds]),
        _build_map_entity("routes", lines=[_build_line(line, LINE_Z, ROUTE) for line in routes]),
        _build_map_entity(
            "buildings",
            lines=[
                _build_line(np.concatenate((building.outline, building.outline[:1])), height, BUILDING)
                for building in roads.buildings
                for height in (LINE_Z, BUILDING_M)
            ],
            surfaces=_triangulate([building.outline for building in roads.buildings], BUILDING_M, BUILDING),
        ),
    ]


def _build_map_entity(
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
