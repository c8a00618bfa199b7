"""Frames of a recording, as the loop and the sensors take them."""

import numpy as np

from mdrive_sumo.core.geometry import Int, wrap_angle
from mdrive_sumo.core.state import DT, Actors, EgoState, Frame
from mdrive_sumo.episode.episode import EpisodeRecord


def rebuild_frame(episode: EpisodeRecord, tick: int, columns: Int | None = None) -> Frame:
    """Return the recorded frame of a tick, without contacts and signals.

    columns: the road users to take, of those in the world; None: all. Acceleration and yaw rate of CAVs are differences
    to the tick before, because a recording does not have them; steering angles are 0.
    """
    e = episode
    present = np.flatnonzero(e.valid[tick]) if columns is None else columns
    cavs, rest = present[present < e.egos], present[present >= e.egos]
    state = (e.x[tick, rest], e.y[tick, rest], e.yaw[tick, rest], e.speed[tick, rest])
    actors = Actors(tuple(e.ids[i] for i in rest.tolist()), e.kind[rest], *state, e.length[rest], e.width[rest])
    return Frame(tick, {e.ids[i]: _build_ego_state(e, tick, i) for i in cavs.tolist()}, actors, {})


def _build_ego_state(episode: EpisodeRecord, tick: int, column: int) -> EgoState:
    e, before = episode, max(tick - 1, 0)
    x, y, yaw, speed = (float(values[tick, column]) for values in (e.x, e.y, e.yaw, e.speed))
    acceleration = (speed - float(e.speed[before, column])) / DT
    return EgoState(x, y, yaw, speed, acceleration, wrap_angle(yaw - float(e.yaw[before, column])) / DT)
