"""Crossing a stop line at red, in scenarios with running signal programs (protocol 7.1)."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads.road_map import Lane
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, EpisodeMismatch, InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric

RED = frozenset("rRu")
"""SUMO's letters for red and red-yellow. Crossing at yellow is allowed."""
LINE_REACH_M = 5.0
"""A stop line extends this far [m] to both sides of the lane, so that a lane change does not avoid it."""
PENALTY_FACTOR = 0.70
"""Protocol 7.1."""


def find_red_light_infractions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the stop lines of the route that the box centre crossed for the first time while the light was red.

    A stop line is the end of a lane of the route before a controlled connection to the next lane. The original
    checks a point near the front bumper against every light and never fires, so this rule is our own.
    """
    if track.scenario.signals == "frozen-green":
        return ()
    crossed = ((light, _find_crossing_tick(track, lane)) for lane, light in _iterate_controlled_lanes(track))
    return tuple(
        track.make_infraction("red-light", tick, light, PENALTY_FACTOR)
        for light, tick in crossed
        if tick is not None and _find_signal_letter(track.episode, light, tick) in RED
    )


def _iterate_controlled_lanes(track: EgoTrack) -> Iterator[tuple[Lane, str]]:
    """Yield the lanes of the route that end at a light, with that light as "tls:index"."""
    ids = track.ego.lanes
    for lane_id, next_id in pairwise(ids):
        lane = track.roads.lanes[lane_id]
        if next_id in lane.lights:
            yield lane, lane.lights[next_id]


def _find_crossing_tick(track: EgoTrack, lane: Lane) -> int | None:
    """Return the first tick in which the centre has crossed the end of `lane`; None if it never does."""
    yaw = float(lane.centre.yaws[-1])
    dx, dy = (track.xy - lane.centre.xy[-1]).T
    cos, sin = portable.cos_sin(yaw)
    beyond = dx * cos + dy * sin > 0.0
    is_beside_line = np.abs(dy * cos - dx * sin) <= LINE_REACH_M
    crossed = np.flatnonzero(beyond[1:] & ~beyond[:-1] & is_beside_line[1:])
    return int(crossed[0]) + 1 if len(crossed) else None


def _find_signal_letter(episode: EpisodeRecord, light: str, tick: int) -> str:
    """Return the SUMO letter that the light "tls:index" shows in a tick."""
    tls, _, index = light.rpartition(":")
    shown = [change.state for change in episode.signals if change.light == tls and change.tick <= tick]
    if not shown:
        raise EpisodeMismatch(f"episode of {episode.scenario}: expected the state of light {tls}, found none")
    return shown[-1][int(index)]


RED_LIGHTS = InfractionMetric("red_lights", find_red_light_infractions)
