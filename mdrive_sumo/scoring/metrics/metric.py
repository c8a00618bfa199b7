"""The two kinds of metrics. A metric reads a finished episode; it never runs during the episode."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent, build_ego_track
from mdrive_sumo.scoring.score_mode import ScoreMode


@dataclass(frozen=True, slots=True)
class InfractionMetric:
    """A rule that finds the infractions of one CAV; their factors multiply its infraction penalty IP."""

    name: str
    find: Callable[[EgoTrack], tuple[InfractionEvent, ...]]
    modes: frozenset[ScoreMode] = frozenset(ScoreMode)
    """The score modes in which it is an infraction."""


@dataclass(frozen=True)
class ScoredEpisode:
    """The input of a scalar metric."""

    episode: EpisodeRecord
    scenario: Scenario
    roads: RoadMap

    @cached_property
    def tracks(self) -> tuple[EgoTrack, ...]:
        """The track of every CAV, in the order of the scenario file.

        Raises InputError for an episode of another scenario and EpisodeMismatch for one that contradicts itself.
        """
        expected = (self.scenario.id, tuple(ego.id for ego in self.scenario.egos))
        found = (self.episode.scenario, self.episode.ego_ids)
        if found != expected:
            raise InputError(
                f"recording of {found[0]}: expected scenario {expected[0]} with CAVs {', '.join(expected[1])},"
                f" found {found[0]} with {', '.join(found[1])}"
            )
        return tuple(
            build_ego_track(self.episode, self.scenario, self.roads, column)
            for column in range(len(self.scenario.egos))
        )


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
