"""The two kinds of metrics. A metric reads a finished episode; it never runs during the episode."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent


@dataclass(frozen=True, slots=True)
class InfractionMetric:
    """A rule that finds the infractions of one CAV; their factors multiply its infraction penalty IP."""

    name: str
    find: Callable[[EgoTrack], tuple[InfractionEvent, ...]]


class ScoredEpisode(NamedTuple):
    """The input of a scalar metric."""

    episode: EpisodeRecord
    scenario: Scenario
    roads: RoadMap


@dataclass(frozen=True, slots=True)
class ScalarMetric:
    """One number per episode, for information only: no score depends on it."""

    name: str
    """Key in `results.json`."""
    label: str
    """Column header with unit."""
    compute: Callable[[ScoredEpisode], float | None]
    """Returns the value; None where it is undefined."""
    decimals: int = 2
    """Number of decimals in tables."""
