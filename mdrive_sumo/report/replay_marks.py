"""Marks of a replay page on the timeline and on the map: infractions and arrivals."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.state import End
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult


@dataclass(frozen=True, slots=True)
class ReplayMark:
    """An event on the timeline and on the map: an infraction, or how a CAV ended.

    `kind` is a word such as "collision-vehicle", "blocked" or "arrived"; x and y are in the world frame [m].
    """

    tick: int
    ego: str
    kind: str
    text: str
    x: float
    y: float


def find_marks(episode: EpisodeRecord, result: ScenarioResult) -> list[ReplayMark]:
    """Return the marks of a scored episode, sorted by tick."""
    infractions = [_mark_infraction(ego, event) for ego in result.egos for event in ego.infractions]
    arrivals = [_mark_arrival(episode, ending) for ending in episode.endings if ending.end is End.ARRIVED]
    return sorted((*infractions, *arrivals), key=lambda mark: mark.tick)


def _mark_infraction(ego: EgoResult, event: Infraction) -> ReplayMark:
    cost = f", x {event.factor:.2f}" if event.factor < 1.0 else ""
    partner = f" with {event.other}" if event.other else ""
    return ReplayMark(event.tick, ego.id, event.kind, f"{event.kind}{partner}{cost}", event.x, event.y)


def _mark_arrival(episode: EpisodeRecord, ending: Ending) -> ReplayMark:
    column = episode.ego_ids.index(ending.ego)
    last = int(np.flatnonzero(episode.valid[:, column])[-1])
    x, y = float(episode.x[last, column]), float(episode.y[last, column])
    return ReplayMark(last, ending.ego, str(ending.end), "arrived", x, y)
