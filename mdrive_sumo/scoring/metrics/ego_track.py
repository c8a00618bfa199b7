"""The trajectory of one CAV in an episode, the input of infraction metrics."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.roads.road_map import NearestLanes, RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scoring.criteria import RouteReference, build_route_reference


@dataclass(frozen=True, slots=True)
class InfractionEvent:
    """One infraction of one CAV. `factor` multiplies its infraction penalty IP; 1.0 marks an event without penalty."""

    kind: str
    tick: int
    x: float
    """Box centre of the CAV in that tick [m]."""
    y: float
    factor: float
    other: str = ""
    """Id of the road user ("" for a building), stop sign or traffic light concerned."""
    impact_speed: float | None = None
    """Relative speed [m/s] in the tick before the contact; None for infractions other than collisions."""


class EpisodeMismatch(Exception):
    """A recording contradicts its own frames: an error of this benchmark, never of a participant."""


@dataclass(frozen=True, slots=True)
class TrackPiece:
    """The latest n ticks of a CAV that still drives: what the rules read of an `EgoTrack`, under the same names."""

    xy: Float
    """(n, 2) [m]"""
    yaw: Float
    """(n,) [rad]"""
    speed: Float
    """(n,) signed along yaw [m/s]."""
    nearest: NearestLanes
    """(n,)"""
    roads: RoadMap


@dataclass(frozen=True)
class EgoTrack:
    """The n ticks of one CAV, from tick 0 to the tick in which it ended, inclusive."""

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
    def reference(self) -> RouteReference:
        """The route in the form that the criteria use."""
        return build_route_reference(self.ego)

    @cached_property
    def nearest(self) -> NearestLanes:
        """The nearest driving lane in every tick (n,). The search is expensive, so it runs once per position."""
        moved = np.concatenate(((True,), (np.diff(self.xy, axis=0) != 0).any(axis=1)))
        nearest, row = self.roads.find_nearest_lanes(self.xy[moved]), np.cumsum(moved) - 1
        return NearestLanes(nearest.lane[row], nearest.distance[row], nearest.yaw[row])

    @cached_property
    def speed_limits(self) -> Float:
        """The limit (n,) [m/s] in every tick: that of the lane under the box centre (`RoadMap.legal_speed`).

        Where lanes overlap it is the greatest of those that cover the centre, beside all lanes that of the nearest.
        """
        legal = self.roads.legal_speed
        limits = legal[self.nearest.lane]
        fast = np.flatnonzero(np.abs(self.speed) > limits)
        point, lane = self.roads.find_lanes_under(self.xy[fast])
        np.maximum.at(limits, fast[point], legal[lane])
        return limits

    def make_infraction(self, kind: str, tick: int, other: str = "", factor: float = 1.0) -> InfractionEvent:
        """Return an infraction of this CAV at its position in `tick`."""
        x, y = self.xy[tick].tolist()
        return InfractionEvent(kind, tick, x, y, factor, other)


def build_ego_track(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap, column: int) -> EgoTrack:
    """Return the track of the CAV in a column. Raises EpisodeMismatch if it is not in every frame up to its end."""
    ego = scenario.egos[column]
    endings = [ending for ending in episode.endings if ending.ego == ego.id]
    if len(endings) != 1:
        raise EpisodeMismatch(
            f"episode of {episode.scenario}: expected one ending of CAV {ego.id}, found {len(endings)}"
        )
    ticks = slice(0, endings[0].tick + 1)
    present = np.flatnonzero(episode.valid[:, column])
    if not np.array_equal(present, np.arange(endings[0].tick + 1)):
        raise EpisodeMismatch(
            f"episode of {episode.scenario}: expected CAV {ego.id} in the frames of ticks 0 to"
            f" {endings[0].tick}, in which it ended, found it in {len(present)} frames"
        )
    return EgoTrack(
        ego=ego,
        ending=endings[0],
        xy=np.column_stack((episode.x[ticks, column], episode.y[ticks, column])),
        yaw=episode.yaw[ticks, column],
        speed=episode.speed[ticks, column],
        episode=episode,
        scenario=scenario,
        roads=roads,
    )
