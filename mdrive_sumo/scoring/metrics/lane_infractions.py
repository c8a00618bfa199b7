"""Outside lanes and wrong lane (protocol 7.3)."""

from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Bool, wrap_angles
from mdrive_sumo.scoring.criteria import advanced
from mdrive_sumo.scoring.metrics.ego_track import Track
from mdrive_sumo.scoring.metrics.infraction import Infraction

OUTSIDE_MARGIN_M = 1.3
"""A centre may be this far beyond the edge of its nearest lane."""
WRONG_AFTER_JUNCTION_RAD = np.radians(120.0)
WRONG_BETWEEN_LANES_RAD = np.radians(150.0)
DISTANCE_WINDOW = 3


def lanes(track: Track) -> tuple[Infraction, ...]:
    """One infraction at the end of a CAV that drove a share of its way outside lanes or on a wrong one.

    Its factor is 1 minus that share of the way made, measured in route points newly passed (window 3).
    """
    share = wrong_share(track)
    if share == 0.0:
        return ()
    x, y = track.xy[-1].tolist()
    return (Infraction("outside-lanes", len(track.xy) - 1, x, y, 1.0 - share),)


def wrong_share(track: Track) -> float:
    """Share in [0, 1] of the way made that was outside lanes or on a wrong lane; 0 if none was made."""
    course, index = track.course, 0
    total = wrong = 0.0
    bad = outside_lanes(track) | wrong_lane(track)
    for (x, y), is_bad in zip(track.xy.tolist(), bad.tolist(), strict=True):
        now = advanced(course, index, DISTANCE_WINDOW, x, y)
        if now > index:
            total += course.s[now] - course.s[index]
            wrong += (course.s[now] - course.s[index]) * is_bad
            index = now
    return wrong / total if wrong else 0.0


def outside_lanes(track: Track) -> Bool:
    """Per tick (n,): whether the centre is over half a lane width + 1.3 m off the nearest lane's centre line.

    SUMO has no parking lanes, the only other lanes that the original allows.
    """
    nearest = track.nearest
    return nearest.distance > track.roads.lane_width[nearest.lane] / 2 + OUTSIDE_MARGIN_M


def wrong_lane(track: Track) -> Bool:
    """Per tick (n,): whether the CAV drives on a lane of the other direction, as the original decides it.

    Never inside a junction. Else the answer changes only with the nearest lane: coming from a junction it is
    whether CAV and lane make at least 120 degrees; coming from a road it flips if the lane direction turned
    by 150 degrees or more, and is "no" otherwise. It starts with "no".
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
