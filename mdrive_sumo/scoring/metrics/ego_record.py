"""EgoRecord: all that scoring needs to know about one CAV of an episode."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics.collisions import collisions
from mdrive_sumo.scoring.metrics.ego_track import Track, track_of
from mdrive_sumo.scoring.metrics.endings import endings, route_completion
from mdrive_sumo.scoring.metrics.infraction import Infraction
from mdrive_sumo.scoring.metrics.lane_infractions import lanes
from mdrive_sumo.scoring.metrics.red_lights import red_lights
from mdrive_sumo.scoring.metrics.stop_signs import stop_signs

METRICS: Mapping[str, Callable[[Track], tuple[Infraction, ...]]] = MappingProxyType(
    {
        "collisions": collisions,
        "red_lights": red_lights,
        "stop_signs": stop_signs,
        "lanes": lanes,
        "endings": endings,
    }
)
"""Every family of infractions."""


@dataclass(frozen=True, slots=True)
class EgoRecord:
    """One CAV: how it ended, route completion RC [%], and its infractions in the order of time."""

    id: str
    ending: Ending
    rc: float
    infractions: tuple[Infraction, ...]

    @property
    def ip(self) -> float:
        """Infraction penalty IP in [0, 1]: the product of the factors (protocol 7.1)."""
        return math.prod(infraction.factor for infraction in self.infractions)


def ego_records(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap) -> tuple[EgoRecord, ...]:
    """The record of every CAV, in the order of the scenario.

    Raises InputError for an episode of another scenario and EpisodeMismatch for one that contradicts itself.
    """
    expected = (scenario.id, tuple(ego.id for ego in scenario.egos))
    found = (episode.scenario, episode.ego_ids)
    if found != expected:
        raise InputError(
            f"recording of {found[0]}: expected scenario {expected[0]} with CAVs {', '.join(expected[1])},"
            f" found {found[0]} with {', '.join(found[1])}"
        )
    return tuple(_record(track_of(episode, scenario, roads, column)) for column in range(len(scenario.egos)))


def _record(track: Track) -> EgoRecord:
    rc = route_completion(track)
    found = [infraction for metric in METRICS.values() for infraction in metric(track)]
    found.sort(key=lambda infraction: infraction.tick)
    return EgoRecord(track.ego.id, track.ending, rc, tuple(found))
