"""Visibility between road users for the replay page, computed from the recording."""

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Int
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

SIGHT_EVERY_TICKS = 4
SIGHT_RANGE_M = 100.0
MIN_VISIBLE_FRACTION = 0.1
"""A road user of which less is visible counts as hidden; the threshold of the ideal detector."""


def compute_visibility(episode: EpisodeRecord, roads: RoadMap) -> Int:
    """Return (egos, N, S) for every fourth tick: 1 where the CAV sees the road user, else 0."""
    ticks = range(0, episode.ticks, SIGHT_EVERY_TICKS)
    sight = np.zeros((episode.egos, len(episode.ids), len(ticks)), dtype=np.int64)
    buildings = BuildingEdges(roads)
    for column, tick in enumerate(ticks):
        present = np.flatnonzero(episode.valid[tick])
        scene = SensingFrame(tick, _boxes(episode, tick, present), {})
        for row, ego in enumerate(present[present < episode.egos].tolist()):
            boxes = scene.boxes
            eye = SensorPose(float(boxes.x[row]), float(boxes.y[row]), float(boxes.yaw[row]), row)
            sight[ego, present, column] = (
                SightView(eye, scene, buildings, SIGHT_RANGE_M).visible_fractions() >= MIN_VISIBLE_FRACTION
            )
    return sight


def _boxes(episode: EpisodeRecord, tick: int, present: Int) -> Objects:
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
