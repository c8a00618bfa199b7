"""The scored facts of every CAV of an episode: ending, route completion, infractions."""

import math
from dataclasses import dataclass

from mdrive_sumo.episode import Ending
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent
from mdrive_sumo.scoring.metrics.endings import compute_route_completion
from mdrive_sumo.scoring.metrics.metric import ScoredEpisode
from mdrive_sumo.scoring.metrics.registry import list_infraction_metrics
from mdrive_sumo.scoring.metrics.speeding import SpeedExcess, compute_speed_excess
from mdrive_sumo.scoring.score_mode import ScoreMode


@dataclass(frozen=True, slots=True)
class EgoRecord:
    """One CAV: its ending, route completion RC [%], and infractions in temporal order."""

    id: str
    ending: Ending
    rc: float
    infractions: tuple[InfractionEvent, ...]
    speed_excess: SpeedExcess

    @property
    def ip(self) -> float:
        """Infraction penalty IP in [0, 1]: the product of the factors (protocol 7.1)."""
        return math.prod(infraction.factor for infraction in self.infractions)

    @property
    def time_factor(self) -> float | None:
        """None: a recording alone does not tell it, see `efficiency.apply_reference_times`."""
        return None


def build_ego_records(scored: ScoredEpisode, mode: ScoreMode = ScoreMode.MDRIVE) -> tuple[EgoRecord, ...]:
    """Return the record of every CAV, in the order of the scenario file, with the infractions of a score mode.

    Raises InputError for an episode of another scenario and EpisodeMismatch for one that contradicts itself.
    """
    return tuple(
        EgoRecord(
            track.ego.id,
            track.ending,
            compute_route_completion(track),
            find_infractions(track, mode),
            compute_speed_excess(track),
        )
        for track in scored.tracks
    )


def find_infractions(track: EgoTrack, mode: ScoreMode = ScoreMode.MDRIVE) -> tuple[InfractionEvent, ...]:
    """Return the infractions of one CAV by all metrics of a score mode, in temporal order."""
    metrics = [metric for metric in list_infraction_metrics() if mode in metric.modes]
    infractions = [infraction for metric in metrics for infraction in metric.find(track)]
    return tuple(sorted(infractions, key=lambda infraction: infraction.tick))
