"""Red lights run over, in scenarios whose signals follow their programs (protocol 7.1)."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads.road_map import Lane
from mdrive_sumo.scoring.metrics.ego_track import EpisodeMismatch, Track
from mdrive_sumo.scoring.metrics.infraction import Infraction

RED = frozenset("rRu")
"""SUMO's letters: red and red-yellow. Yellow may be crossed."""
LINE_REACH_M = 5.0
"""A stop line counts this far to both sides of the lane: changing lanes is no way around it."""


def red_lights(track: Track) -> tuple[Infraction, ...]:
    """Stop lines of the route that the box centre crossed, for the first time, while their light was red.

    A stop line is the end of a lane of the route before a controlled connection to the next one. The original
    looks at a point near the front bumper and at every light; it never fires there, so this rule is ours.
    """
    if track.scenario.signals == "frozen-green":
        return ()
    crossed = ((light, _crossing(track, lane)) for lane, light in _controlled(track))
    return tuple(
        track.event("red-light", tick, light)
        for light, tick in crossed
        if tick is not None and _letter(track.episode, light, tick) in RED
    )


def _controlled(track: Track) -> Iterator[tuple[Lane, str]]:
    """Lanes of the route that end at a light, with that light as "tls:index"."""
    ids = track.ego.lanes
    for here, there in pairwise(ids):
        lane = track.roads.lanes[here]
        if there in lane.lights:
            yield lane, lane.lights[there]


def _crossing(track: Track, lane: Lane) -> int | None:
    """The first tick in which the centre is beyond the end of `lane` after one in which it was not."""
    yaw = float(lane.centre.yaws[-1])
    dx, dy = (track.xy - lane.centre.xy[-1]).T
    beyond = dx * np.cos(yaw) + dy * np.sin(yaw) > 0.0
    abreast = np.abs(dy * np.cos(yaw) - dx * np.sin(yaw)) <= LINE_REACH_M
    crossed = np.flatnonzero(beyond[1:] & ~beyond[:-1] & abreast[1:])
    return int(crossed[0]) + 1 if len(crossed) else None


def _letter(episode: EpisodeRecord, light: str, tick: int) -> str:
    """What the light "tls:index" shows in that tick: a letter of its traffic light's recorded state."""
    tls, _, index = light.rpartition(":")
    shown = [change.state for change in episode.signals if change.light == tls and change.tick <= tick]
    if not shown:
        raise EpisodeMismatch(f"episode of {episode.scenario}: expected the state of light {tls}, found none")
    return shown[-1][int(index)]
