"""Track: one CAV's life in an episode, as every metric reads it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.roads.road_map import NearestLanes, RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scoring.criteria import Course, course_of
from mdrive_sumo.scoring.metrics.infraction import PENALTY, Infraction


class EpisodeMismatch(Exception):
    """A recording contradicts what its own frames say: an error of this benchmark, never of a participant."""


@dataclass(frozen=True)
class Track:
    """What one CAV did from tick 0 to the tick that ended it, both included: n ticks."""

    ego: Ego
    ending: Ending
    xy: Float
    """Box centre (n, 2) [m]."""
    yaw: Float
    """(n,) [rad]"""
    speed: Float
    """(n,) signed along yaw [m/s]."""
    episode: EpisodeRecord
    scenario: Scenario
    roads: RoadMap

    @cached_property
    def course(self) -> Course:
        """The route as the criteria read it."""
        return course_of(self.ego)

    @cached_property
    def nearest(self) -> NearestLanes:
        """The nearest driving lane in every tick (n,); looked up once a place, because it is dear."""
        moved = np.concatenate(((True,), (np.diff(self.xy, axis=0) != 0).any(axis=1)))
        found, at = self.roads.nearest(self.xy[moved]), np.cumsum(moved) - 1
        return NearestLanes(found.lane[at], found.distance[at], found.yaw[at])

    def event(self, kind: str, tick: int, other: str = "") -> Infraction:
        """An infraction of this CAV, with its factor of the penalty table (1.0 if it has none)."""
        x, y = self.xy[tick].tolist()
        return Infraction(kind, tick, x, y, PENALTY.get(kind, 1.0), other)


def track_of(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap, column: int) -> Track:
    """The track of the CAV in that column; raises EpisodeMismatch if it was not there until its end."""
    ego = scenario.egos[column]
    endings = [ending for ending in episode.endings if ending.ego == ego.id]
    if len(endings) != 1:
        raise EpisodeMismatch(
            f"episode of {episode.scenario}: expected one ending of CAV {ego.id}, found {len(endings)}"
        )
    life = slice(0, endings[0].tick + 1)
    present = np.flatnonzero(episode.valid[:, column])
    if not np.array_equal(present, np.arange(endings[0].tick + 1)):
        raise EpisodeMismatch(
            f"episode of {episode.scenario}: expected CAV {ego.id} in the frames of ticks 0 to"
            f" {endings[0].tick}, in which it ended, found it in {len(present)} frames"
        )
    return Track(
        ego=ego,
        ending=endings[0],
        xy=np.column_stack((episode.x[life, column], episode.y[life, column])),
        yaw=episode.yaw[life, column],
        speed=episode.speed[life, column],
        episode=episode,
        scenario=scenario,
        roads=roads,
    )
