"""What the viewer marks on the timeline and on the map: infractions and arrivals."""

import numpy as np

from mdrive_sumo.core.state import End
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.report.replay_page import ReplayMark
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult


def find_marks(episode: EpisodeRecord, result: ScenarioResult) -> list[ReplayMark]:
    """Of a scored episode, by time."""
    infractions = [_infraction(ego, event) for ego in result.egos for event in ego.infractions]
    arrivals = [_arrival(episode, ending) for ending in episode.endings if ending.end is End.ARRIVED]
    return sorted((*infractions, *arrivals), key=lambda mark: mark.tick)


def _infraction(ego: EgoResult, event: Infraction) -> ReplayMark:
    cost = f", x {event.factor:.2f}" if event.factor < 1.0 else ""
    whom = f" with {event.other}" if event.other else ""
    return ReplayMark(event.tick, ego.id, event.kind, f"{event.kind}{whom}{cost}", event.x, event.y)


def _arrival(episode: EpisodeRecord, ending: Ending) -> ReplayMark:
    column = episode.ego_ids.index(ending.ego)
    last = int(np.flatnonzero(episode.valid[:, column])[-1])
    x, y = float(episode.x[last, column]), float(episode.y[last, column])
    return ReplayMark(last, ending.ego, str(ending.end), "arrived", x, y)
