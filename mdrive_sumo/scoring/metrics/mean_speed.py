"""Mean speed of the CAVs: informative, no part of any score."""

import math

import numpy as np

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics.metric import ScalarMetric


def compute_mean_speed(episode: EpisodeRecord) -> float | None:
    """Return the mean absolute speed [m/s] over all CAVs and the ticks in which they are in the world."""
    speeds = np.abs(episode.speed[:, : episode.egos][episode.valid[:, : episode.egos]])
    return math.fsum(speeds.tolist()) / len(speeds) if len(speeds) else None


MEAN_SPEED = ScalarMetric("mean_speed", "speed [m/s]", lambda scored: compute_mean_speed(scored.episode))
