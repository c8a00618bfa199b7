"""The scored facts of every CAV of an episode: ending, route completion, infractions."""

import math
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import Ending, EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent, build_ego_track
from mdrive_sumo.scoring.metrics.endings import compute_route_completion
from mdrive_sumo.scoring.metrics.registry import list_infraction_metrics


@dataclass(frozen=True, slots=True)
class EgoRecord:
    """One CAV: its ending, route completion RC [%], and infractions in temporal order."""

    id: str
    ending: Ending
    rc: float
    infractions: tuple[InfractionEvent, ...]

    @property
    def ip(self) -> float:
        """Infraction penalty IP in [0, 1]: the product of the factors (protocol 7.1)."""
        return math.prod(infraction.factor for infraction in self.infractions)

    @property
    def time_factor(self) -> float | None:
        """None: a recording alone does not tell it, see `efficiency.apply_reference_times`."""
        return None


def build_ego_records(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap) -> tuple[EgoRecord, ...]:
    """Return the record of every CAV, in the order of the scenario file.

    Raises InputError for an episode of another scenario and EpisodeMismatch for one that contradicts itself.
    """
    expected = (scenario.id, tuple(ego.id for ego in scenario.egos))
    found = (episode.scenario, episode.ego_ids)
    if found != expected:
        raise InputError(
            f"recording of {found[0]}: expected scenario {expected[0]} with CAVs {', '.join(expected[1])},"
            f" found {found[0]} with {', '.join(found[1])}"
        )
    return tuple(
        _build_ego_record(build_ego_track(episode, scenario, roads, column)) for column in range(len(scenario.egos))
    )


def find_infractions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the infractions of one CAV by all metrics, in temporal order."""
    infractions = [infraction for metric in list_infraction_metrics() for infraction in metric.find(track)]
    return tuple(sorted(infractions, key=lambda infraction: infraction.tick))


def _build_ego_record(track: EgoTrack) -> EgoRecord:
    rc = compute_route_completion(track)
    return EgoRecord(track.ego.id, track.ending, rc, find_infractions(track))
