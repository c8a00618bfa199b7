"""Driving faster than the speed limit: a scalar in every score mode, an infraction in mode `hard` (decision 092)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric, ScalarMetric
from mdrive_sumo.scoring.score_mode import ScoreMode

SPEEDING_KIND = "speeding"
TOLERANCE = 1.1
"""A CAV speeds above this multiple of its limit: the issue asks for 10 %, ours is no better-founded choice."""
FORGIVEN_TICKS = TICKS_PER_SECOND
"""A CAV may speed for this long in all [ticks] without an infraction, e.g. the end of braking for a lower limit."""
PENALTY_FACTOR = 0.70
"""That of the CARLA leaderboard for a wrong speed (`MIN_SPEED_INFRACTION` of leaderboard 2.0), and of a red light."""


@dataclass(frozen=True, slots=True)
class SpeedExcess:
    """How long and by how much one CAV was faster than its limit."""

    share: float
    """Share [%] of its ticks in which it was more than 10 % faster."""
    greatest: float
    """Greatest difference from the limit [m/s]; 0 if it was never faster."""


def compute_speed_excess(track: EgoTrack) -> SpeedExcess:
    """Return how long and by how much a CAV was faster than its limit."""
    excess = np.abs(track.speed) - track.speed_limits
    return SpeedExcess(compute_speeding_share([track]), max(float(excess.max()), 0.0))


def compute_speeding_share(tracks: Sequence[EgoTrack]) -> float:
    """Return the share [%] of the ticks of these CAVs in which they were more than 10 % faster than their limits."""
    ticks = sum(len(track.speed) for track in tracks)
    return 100.0 * sum(np.count_nonzero(_find_speeding_ticks(track)) for track in tracks) / ticks


def find_speeding_infraction(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return one infraction, in the tick with which a CAV has sped for more than a second in all."""
    ticks = np.flatnonzero(_find_speeding_ticks(track))
    return tuple(
        track.make_infraction(SPEEDING_KIND, int(tick), factor=PENALTY_FACTOR)
        for tick in ticks[FORGIVEN_TICKS : FORGIVEN_TICKS + 1]
    )


def _find_speeding_ticks(track: EgoTrack) -> Bool:
    return np.abs(track.speed) > TOLERANCE * track.speed_limits


SPEEDING = ScalarMetric("speeding", "speeding [%]", lambda scored: compute_speeding_share(scored.tracks), 1)
SPEED_LIMITS = InfractionMetric("speed_limits", find_speeding_infraction, frozenset({ScoreMode.HARD}))
