"""Crossing a stop line at red, in scenarios with running signal programs (protocol 7.1)."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads.road_map import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
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
    crossings = StopLineWatch(track.roads, track.ego).add(track.xy)
    return tuple(
        track.make_infraction("red-light", tick, light, PENALTY_FACTOR)
        for tick, light in crossings
        if is_red(_find_signal_state(track.episode, light, tick), light)
    )


class StopLineCrossing(NamedTuple):
    """The first crossing of a stop line by the box centre."""

    tick: int
    light: str
    """As "tls:index"."""


class StopLineWatch:
    """The stop lines that one CAV crosses, in whole tracks or piece by piece as it drives, with the same result."""

    def __init__(self, roads: RoadMap, ego: Ego) -> None:
        self._left = list(_iterate_controlled_lanes(roads, ego))
        """Stop lines that have not been crossed."""
        self._before = np.zeros((0, 2))
        """The last place (1, 2) [m] of the piece before; (0, 2) before the first piece."""
        self._ticks = 0

    def add(self, xy: Float) -> list[StopLineCrossing]:
        """Take the next places (n, 2) [m], one a tick, and return the first crossings among them."""
        first_tick = self._ticks - len(self._before)
        path = np.concatenate((self._before, xy))
        rows = [(lane, light, _find_crossing(path, lane)) for lane, light in self._left]
        self._left = [(lane, light) for lane, light, row in rows if row is None]
        self._before = path[-1:]
        self._ticks += len(xy)
        return [StopLineCrossing(first_tick + row, light) for _, light, row in rows if row is not None]


def is_red(state: str, light: str) -> bool:
    """Return whether the light "tls:index" shows red, in the state of its signal program."""
    return state[int(light.rpartition(":")[2])] in RED


def _iterate_controlled_lanes(roads: RoadMap, ego: Ego) -> Iterator[tuple[Lane, str]]:
    """Yield the lanes of the route that end at a light, with that light as "tls:index"."""
    for lane_id, next_id in pairwise(ego.lanes):
        lane = roads.lanes[lane_id]
        if next_id in lane.lights:
            yield lane, lane.lights[next_id]


def _find_crossing(path: Float, lane: Lane) -> int | None:
    """Return the first row in which a centre (n, 2) has crossed the end of `lane`; None if it never does."""
    yaw = float(lane.centre.yaws[-1])
    dx, dy = (path - lane.centre.xy[-1]).T
    cos, sin = portable.cos_sin(yaw)
    beyond = dx * cos + dy * sin > 0.0
    is_beside_line = np.abs(dy * cos - dx * sin) <= LINE_REACH_M
    crossed = np.flatnonzero(beyond[1:] & ~beyond[:-1] & is_beside_line[1:])
    return int(crossed[0]) + 1 if len(crossed) else None


def _find_signal_state(episode: EpisodeRecord, light: str, tick: int) -> str:
    """Return the state of the signal program of the light "tls:index" in a tick."""
    tls = light.rpartition(":")[0]
    shown = [change.state for change in episode.signals if change.light == tls and change.tick <= tick]
    if not shown:
        raise EpisodeMismatch(f"episode of {episode.scenario}: expected the state of light {tls}, found none")
    return shown[-1]


RED_LIGHTS = InfractionMetric("red_lights", find_red_light_infractions)
