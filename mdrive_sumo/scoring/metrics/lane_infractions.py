"""Driving outside lanes or on a wrong lane (protocol 7.3)."""

from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Bool, wrap_angles
from mdrive_sumo.scoring.criteria import advance_index
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric

OUTSIDE_LANES = "outside-lanes"
"""Kind of the infraction."""
OUTSIDE_MARGIN_M = 1.3
"""A box centre may be this far [m] beyond the edge of its nearest lane."""
WRONG_AFTER_JUNCTION_RAD = np.radians(120.0)
WRONG_BETWEEN_LANES_RAD = np.radians(150.0)
DISTANCE_WINDOW = 3


def find_lane_infractions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return one infraction, at the end, of a CAV that drove a share of its way outside lanes or on a wrong lane.

    Its factor is 1 minus that share of the distance driven, measured by newly passed route points (window 3).
    """
    share = compute_wrong_share(track)
    if share == 0.0:
        return ()
    x, y = track.xy[-1].tolist()
    return (InfractionEvent(OUTSIDE_LANES, len(track.xy) - 1, x, y, 1.0 - share),)


def compute_wrong_share(track: EgoTrack) -> float:
    """Return the share in [0, 1] of the distance driven outside lanes or on a wrong lane; 0 without any distance."""
    reference, index = track.reference, 0
    total = wrong = 0.0
    is_infringing = find_infringing_ticks(track).tolist()
    for (x, y), infringes in zip(track.xy.tolist(), is_infringing, strict=True):
        now = advance_index(reference, index, DISTANCE_WINDOW, x, y)
        if now > index:
            total += reference.s[now] - reference.s[index]
            wrong += (reference.s[now] - reference.s[index]) * infringes
            index = now
    return wrong / total if wrong else 0.0


def find_infringing_ticks(track: EgoTrack) -> Bool:
    """Return an (n,) mask: the CAV is outside lanes or on a wrong lane."""
    return find_outside_lanes(track) | find_wrong_lane(track)


def find_outside_lanes(track: EgoTrack) -> Bool:
    """Return an (n,) mask: the centre is over half a lane width + 1.3 m off the nearest lane's centre line.

    SUMO has no parking lanes, which the original allows as well.
    """
    nearest = track.nearest
    return nearest.distance > track.roads.lane_width[nearest.lane] / 2 + OUTSIDE_MARGIN_M


def find_wrong_lane(track: EgoTrack) -> Bool:
    """Return an (n,) mask: the CAV drives on a lane of the opposite direction, as the original decides it.

    False inside a junction and on the first lane. Elsewhere the value changes with the nearest lane only: after a
    junction it is true if CAV and lane form at least 120 degrees; after another lane it flips if the lane direction
    turned by 150 degrees or more, and is false otherwise.
    """
    nearest = track.nearest
    junction = track.roads.in_junction[nearest.lane]
    against = np.abs(wrap_angles(track.yaw - nearest.yaw)) >= WRONG_AFTER_JUNCTION_RAD
    turned = np.zeros(len(junction), dtype=np.bool_)
    turned[1:] = np.abs(wrap_angles(np.diff(nearest.yaw))) >= WRONG_BETWEEN_LANES_RAD
    wrong = np.zeros(len(junction), dtype=np.bool_)
    changes = np.flatnonzero(np.diff(nearest.lane)) + 1
    for begin, end in pairwise((*changes.tolist(), len(junction))):
        if not junction[begin]:
            before = bool(wrong[begin - 1])
            wrong[begin:end] = against[begin] if junction[begin - 1] else turned[begin] and not before
    return wrong


LANE_INFRACTIONS = InfractionMetric("lanes", find_lane_infractions)
