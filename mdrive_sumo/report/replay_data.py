"""The data of a replay page: an episode, its map and its marks as one block of base64 text.

The block is a gzip stream of a JSON header and int32 tables, so no id or text of a file can become markup. Images of
cameras are a block of JSON beside it.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.episode.camera_archive import CameraTrack
from mdrive_sumo.report.map_view import find_area
from mdrive_sumo.report.replay_marks import ReplayMark
from mdrive_sumo.report.replay_messages import build_message_tables
from mdrive_sumo.report.replay_notes import list_notes
from mdrive_sumo.report.replay_scene import LAMPS_EVERY_TICKS, build_boxes, list_looks, tabulate_lamps
from mdrive_sumo.report.scene_3d import pack_tables
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import SignalHead, StopMark, build_map_geometry, list_signal_heads
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

SIGHT_EVERY_TICKS = 4
"""Ticks between two looks: 5 a second, as contents of messages are shown (`SHOWN_EVERY_TICKS`)."""
SIGHT_RANGE_M = 100.0
"""[m] Beyond, sight is not computed."""
MIN_VISIBLE_FRACTION = 0.1
"""A road user of which less is visible counts as hidden; the threshold of the ideal detector."""
SURROUNDINGS_M = 80.0
"""Roads farther than this from every road user and route are left out of the page."""
CELL_M = 20.0
"""Side of the grid cells by which positions are grouped before the surroundings are computed around them."""
MAX_PAGE_BYTES = 12 * 2**20
"""Of all images of a page; of more, every second, third ... image is shown."""


def compute_visibility(episode: EpisodeRecord, roads: RoadMap) -> Int:
    """Return (egos, N, S) for every fourth tick: 1 where the CAV sees the road user, else 0."""
    ticks = range(0, episode.ticks, SIGHT_EVERY_TICKS)
    sight = np.zeros((episode.egos, len(episode.ids), len(ticks)), dtype=np.int64)
    buildings = BuildingEdges(roads)
    for column, tick in enumerate(ticks):
        present = np.flatnonzero(episode.valid[tick])
        scene = SensingFrame(tick, build_boxes(episode, tick), {})
        for row, ego in enumerate(present[present < episode.egos].tolist()):
            boxes = scene.boxes
            eye = SensorPose(float(boxes.x[row]), float(boxes.y[row]), float(boxes.yaw[row]), row)
            sight[ego, present, column] = (
                SightView(eye, scene, buildings, SIGHT_RANGE_M).visible_fractions() >= MIN_VISIBLE_FRACTION
            )
    return sight


def pack_replay_data(
    episode: EpisodeRecord,
    scenario: Scenario,
    roads: RoadMap,
    marks: Sequence[ReplayMark],
    result: ScenarioResult | None = None,
) -> str:
    """Return the data block of a page; without a result it has no scores."""
    origin = find_origin(scenario)
    talk, talk_tables = build_message_tables(episode, scenario, origin)
    tables = {
        "motion": _motion(episode, origin),
        "valid": episode.valid.T,
        "controls": np.moveaxis(episode.controls, 0, -1),
        "plan_points": _plan_points(episode, origin),
        "sight": compute_visibility(episode, roads),
        "lamps": tabulate_lamps(episode, roads),
        **talk_tables,
    }
    header = {
        **_run(episode, scenario, marks, origin),
        "scores": None if result is None else _scores(episode, result),
        "origin": origin.tolist(),
        "map": pack_map(roads, _surroundings(episode, scenario), origin),
        "talk": talk,
        "notes": list_notes(episode),
        "sight_every": SIGHT_EVERY_TICKS,
        "sight_range": SIGHT_RANGE_M,
        "lamps_every": LAMPS_EVERY_TICKS,
        "looks": list_looks(episode),
        "weather": scenario.weather,
    }
    return base64.b64encode(pack_tables(header, tables)).decode()


def find_origin(scenario: Scenario) -> Float:
    """Return the origin (2,) [m] of a page's coordinates, rounded to metres.

    Browsers draw paths in single precision: coordinates stay small, wherever the network has its origin.
    """
    return np.rint((scenario.egos[0].start.x, scenario.egos[0].start.y))


def _motion(episode: EpisodeRecord, origin: Float) -> Int:
    """(N, 4, T): x, y [mm] from the origin, yaw [0.1 mrad], speed [mm/s]."""
    shift = np.array((*(origin * 1000), 0, 0)).astype(np.int64)
    return np.moveaxis(np.where(episode.valid[..., None], episode.quanta - shift, 0), 0, -1)


def _plan_points(episode: EpisodeRecord, origin: Float) -> Int:
    """(2, K): the points of all plans, one after the other [cm] from the origin."""
    points = [plan.points for plan in episode.plans]
    return _centimetres(np.concatenate([*points, np.zeros((0, 2))]), origin).T


def _centimetres(xy: Float, origin: Float) -> Int:
    return np.rint((xy - origin) * 100).astype(np.int64)


def _run(episode: EpisodeRecord, scenario: Scenario, marks: Sequence[ReplayMark], origin: Float) -> dict[str, Any]:
    """What happened, other than motion. CAVs are named by their column."""
    column = {ego: i for i, ego in enumerate(episode.ego_ids)}
    routes = {ego.id: pack_line(ego.xy, origin) for ego in scenario.egos}
    return {
        "scenario": scenario.id,
        "description": scenario.description,
        "category": f"{scenario.bucket} / {scenario.category}",
        "network": scenario.network,
        "about": {str(key): str(value) for key, value in episode.about.items()},
        "tick_s": DT,
        "ticks": episode.ticks,
        "ids": episode.ids,
        "egos": episode.egos,
        "kinds": [Kind(kind).name.lower() for kind in episode.kind.tolist()],
        "sizes": np.round(np.stack((episode.length, episode.width), axis=-1), 2).tolist(),
        "routes": [routes[ego] for ego in episode.ego_ids],
        "endings": [_ending(column, ending) for ending in episode.endings],
        "marks": [astuple(mark)[:4] + tuple(pack_line(np.array([(mark.x, mark.y)]), origin)) for mark in marks],
        "contacts": [(tick, column[contact.ego], contact.other) for tick, contact in episode.contacts],
        "signals": [(change.tick, change.light, change.state) for change in episode.signals],
        "plans": [(plan.tick, column[plan.ego], len(plan.points)) for plan in episode.plans],
    }


def _scores(episode: EpisodeRecord, result: ScenarioResult) -> dict[str, Any]:
    """Scores of the scenario, and of each CAV by its column: [DS %, RC %, IP], None for one without."""
    of_ego = {ego.id: (ego.ds, ego.rc, ego.ip) for ego in result.egos}
    scenario = {"ds": result.ds, "sr": result.sr, "rc": result.rc, "ip": result.ip}
    return scenario | {"egos": [of_ego.get(ego) for ego in episode.ego_ids]}


def _ending(column: Mapping[str, int], ending: Ending) -> tuple[int, int, str, str]:
    """Column of the CAV, tick, word, and why its agent failed if it did."""
    reason = " ".join(filter(None, (ending.failure, ending.text)))
    return column[ending.ego], ending.tick, str(ending.end), reason


def pack_line(xy: Float, origin: Float) -> list[int]:
    """Points as x0, y0, x1, y1, ... [cm] from the origin."""
    return _centimetres(xy, origin).ravel().tolist()


def _surroundings(episode: EpisodeRecord, scenario: Scenario) -> BaseGeometry:
    """The area within `SURROUNDINGS_M` of every road user and of every route."""
    present = np.stack((episode.x[episode.valid], episode.y[episode.valid]), axis=-1)
    return find_area(np.concatenate([present, *(ego.xy for ego in scenario.egos)]), SURROUNDINGS_M, CELL_M)


def pack_map(roads: RoadMap, area: Any, origin: Float) -> dict[str, Any]:
    """The roads that come near the area, each whole: the geometry that plots draw as well."""
    geometry = build_map_geometry(roads, area)
    return {
        "pavements": [_rings(shape, origin) for shape in geometry.pavements],
        "aprons": [_rings(shape, origin) for shape in geometry.aprons],
        "asphalt": [_rings(shape, origin) for shape in geometry.asphalt],
        "stripes": [_rings(shape, origin) for shape in geometry.stripes],
        "solid": [pack_line(line, origin) for line in geometry.markings.solid],
        "dashed": [pack_line(line, origin) for line in geometry.markings.dashed],
        "buildings": [_rings(shape, origin) for shape in geometry.buildings],
        "heads": [_head(head, origin) for head in list_signal_heads(roads, area)],
        "stops": [(pack_line(mark.line, origin), _sign(mark, origin)) for mark in geometry.stop_signs],
        "signs_known": roads.stop_signs is not None,
    }


def _rings(shape: shapely.Polygon, origin: Float) -> list[list[int]]:
    """Outline counter-clockwise, holes clockwise: areas that overlap are filled once, holes are not."""
    turned = orient(shape)
    return [pack_line(shapely.get_coordinates(ring)[:-1], origin) for ring in (turned.exterior, *turned.interiors)]


def _head(head: SignalHead, origin: Float) -> tuple[list[int], float, float, tuple[str, ...]]:
    """Where a lane with lights ends [cm], its direction there [rad], its width [m], the ids of the lights."""
    return pack_line(head.place[None], origin), round(head.yaw, 4), round(head.width, 2), head.lights


def _sign(mark: StopMark, origin: Float) -> list[int] | None:
    return None if mark.sign is None else pack_line(mark.sign[None], origin)


def pack_camera_images(episode: EpisodeRecord, tracks: Sequence[CameraTrack]) -> str:
    """Return the images of the CAVs of an episode; "" without any."""
    of_cavs = [track for track in tracks if track.ego in episode.ego_ids and track.images]
    size = sum(len(image) for track in of_cavs for image in track.images.values())
    step = -(-size // MAX_PAGE_BYTES)
    packed = [_pack_track(episode, track, step) for track in of_cavs]
    return json.dumps(packed, separators=(",", ":")).replace("<", "\\u003c") if packed else ""


def _pack_track(episode: EpisodeRecord, track: CameraTrack, step: int) -> dict[str, Any]:
    ticks = [tick for tick in sorted(track.images) if tick < episode.ticks][::step]
    images = [{"tick": tick, "jpeg": base64.b64encode(track.images[tick]).decode()} for tick in ticks]
    return {"ego": episode.ego_ids.index(track.ego), "camera": track.camera, "images": images}
