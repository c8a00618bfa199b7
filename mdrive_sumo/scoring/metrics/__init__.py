"""Metrics of a finished episode: route completion, infractions and scalars (protocol 6, 7)."""

from mdrive_sumo.scoring.metrics.ego_record import EgoRecord, build_ego_records, find_infractions
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, EpisodeMismatch, InfractionEvent, build_ego_track
from mdrive_sumo.scoring.metrics.metric import InfractionMetric, ScalarMetric, ScoredEpisode
from mdrive_sumo.scoring.metrics.min_ttc import compute_min_ttc
from mdrive_sumo.scoring.metrics.registry import METRICS, list_scalar_metrics
from mdrive_sumo.scoring.metrics.speeding import SpeedExcess

__all__ = [
    "METRICS",
    "EgoRecord",
    "EgoTrack",
    "EpisodeMismatch",
    "InfractionEvent",
    "InfractionMetric",
    "ScalarMetric",
    "ScoredEpisode",
    "SpeedExcess",
    "build_ego_records",
    "build_ego_track",
    "compute_min_ttc",
    "find_infractions",
    "list_scalar_metrics",
]
