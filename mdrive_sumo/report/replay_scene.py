"""What the 3-D view of a replay page needs beside the replay: the scene, the looks of road users, and their lamps."""

import base64
import gzip
from functools import lru_cache

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.map_view import find_area, list_route_points
from mdrive_sumo.report.scene_3d import RoadUserLook, describe_road_user, pack_scene
from mdrive_sumo.report.view_3d_script import build_view_3d_script
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sensing.signal_lamps import SignalLampObserver

LAMPS_EVERY_TICKS = 4
"""Ticks between two looks at lamps: 5 a second, as drivers cannot see more of a lamp that is on for half a second."""
MARGIN_M = 160.0
"""Width of the scene around the places of CAVs and their routes: what is farther is small, and mostly behind houses."""
CELL_M = 20.0
"""Side of the grid cells by which positions are grouped before the area around them is computed."""


def list_looks(episode: EpisodeRecord) -> list[RoadUserLook]:
    """Return model, paint and height of every road user."""
    rows = zip(episode.ids, episode.kind.tolist(), episode.length.tolist(), episode.width.tolist(), strict=True)
    return [describe_road_user(name, Kind(kind), length, width) for name, kind, length, width in rows]


def tabulate_lamps(episode: EpisodeRecord, roads: RoadMap) -> Int:
    """Return the `SignalLamp`s (N, S) that shine in every fourth tick."""
    observer = SignalLampObserver(roads)
    ticks = range(0, episode.ticks, LAMPS_EVERY_TICKS)
    lamps = np.zeros((len(episode.ids), len(ticks)), dtype=np.int64)
    column = {name: i for i, name in enumerate(episode.ids)}
    for place, tick in enumerate(ticks):
        for name, lit in observer.observe(tick, build_boxes(episode, tick)).items():
            lamps[column[name], place] = lit
    return lamps


def build_boxes(episode: EpisodeRecord, tick: int) -> Objects:
    """Return the road users that are in the world in a tick."""
    present = np.flatnonzero(episode.valid[tick])
    return Objects(
        ids=tuple(episode.ids[i] for i in present.tolist()),
        kind=episode.kind[present],
        x=episode.x[tick, present],
        y=episode.y[tick, present],
        yaw=episode.yaw[tick, present],
        speed=episode.speed[tick, present],
        length=episode.length[present],
        width=episode.width[present],
    )


def pack_replay_scene(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap, origin: Float) -> str:
    """Return the packed scene around the CAVs as base64 text; origin (2,): that of the replay's coordinates [m]."""
    area = find_area(list_route_points(episode, scenario), MARGIN_M, CELL_M)
    return base64.b64encode(pack_scene(roads, area, scenario.weather, origin.tolist())).decode()


@lru_cache(maxsize=1)
def pack_view_3d_script() -> str:
    """Return the script of the 3-D view, gzip in base64: a page starts it when its button is pressed."""
    return base64.b64encode(gzip.compress(build_view_3d_script().encode(), compresslevel=9, mtime=0)).decode()
