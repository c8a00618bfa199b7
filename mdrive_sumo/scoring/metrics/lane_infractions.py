"""Driving outside lanes or on a wrong lane (protocol 7.3)."""

from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.roads.road_map import NearestLanes
from mdrive_sumo.scoring.criteria import RouteReference, advance_index
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent, TrackPiece
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
    watch = LaneWatch(track.reference)
    watch.add(track)
    return watch.wrong_share


def find_infringing_ticks(track: EgoTrack) -> Bool:
    """Return an (n,) mask: the CAV is outside lanes or on a wrong lane."""
    return LaneWatch(track.reference).add(track)


def find_outside_lanes(track: EgoTrack | TrackPiece) -> Bool:
    """Return an (n,) mask: the centre is over half a lane width + 1.3 m off the nearest lane's centre line.

    SUMO has no parking lanes, which the original allows as well.
    """
    nearest = track.nearest
    return nearest.distance > track.roads.lane_width[nearest.lane] / 2 + OUTSIDE_MARGIN_M


class LaneWatch:
    """The lanes that one CAV drives on, whole tracks or piece by piece as it drives, with the same result."""

    def __init__(self, reference: RouteReference) -> None:
        self._reference = reference
        self._index = 0
        self._driven_m = 0.0
        self._wrong_m = 0.0
        self._before = NearestLanes(np.zeros(0, np.intp), np.zeros(0), np.zeros(0))
        """Of the last tick of the piece before: one row; none before the first piece."""
        self._is_wrong_lane = False
        """In that tick."""

    @property
    def wrong_share(self) -> float:
        """The share in [0, 1] of the distance so far outside lanes or on a wrong lane; 0 without any distance."""
        return self._wrong_m / self._driven_m if self._wrong_m else 0.0

    def add(self, piece: EgoTrack | TrackPiece) -> Bool:
        """Take the next ticks, and return in which of them (n,) the CAV is outside lanes or on a wrong lane."""
        infringing = find_outside_lanes(piece) | self.find_wrong_lane(piece)
        reference = self._reference
        for (x, y), infringes in zip(piece.xy.tolist(), infringing.tolist(), strict=True):
            now = advance_index(reference, self._index, DISTANCE_WINDOW, x, y)
            if now > self._index:
                self._driven_m += reference.s[now] - reference.s[self._index]
                self._wrong_m += (reference.s[now] - reference.s[self._index]) * infringes
                self._index = now
        return infringing

    def find_wrong_lane(self, piece: EgoTrack | TrackPiece) -> Bool:
        """Return an (n,) mask of the next ticks: the CAV drives on a lane of the opposite direction.

        False inside a junction and on the first lane. Elsewhere the value changes with the nearest lane only, as the
        original decides it: after a junction it is true if CAV and lane form at least 120 degrees; after another lane
        it flips if the lane direction turned by 150 degrees or more, and is false otherwise.
        """
        before = self._before
        first = len(before.lane)  # row of the first new tick
        lane = np.concatenate((before.lane, piece.nearest.lane))
        lane_yaw = np.concatenate((before.yaw, piece.nearest.yaw))
        wrong = np.full(len(lane), self._is_wrong_lane)
        changes = np.flatnonzero(np.diff(lane)) + 1
        if len(changes):
            self._judge_changes(piece, lane, lane_yaw, changes, wrong)
        self._before = NearestLanes(lane[-1:], np.zeros(1), lane_yaw[-1:])
        self._is_wrong_lane = bool(wrong[-1])
        return wrong[first:]

    def _judge_changes(
        self, piece: EgoTrack | TrackPiece, lane: Int, lane_yaw: Float, changes: Int, wrong: Bool
    ) -> None:
        """Write into `wrong` (m,) what holds from each of the rows `changes` on, in which the nearest lane is new."""
        junction = piece.roads.in_junction[lane]
        new = changes - (len(lane) - len(piece.yaw))
        against = np.abs(wrap_angles(piece.yaw[new] - piece.nearest.yaw[new])) >= WRONG_AFTER_JUNCTION_RAD
        turned = np.abs(wrap_angles(lane_yaw[changes] - lane_yaw[changes - 1])) >= WRONG_BETWEEN_LANES_RAD
        for change, (begin, end) in enumerate(pairwise((*changes.tolist(), len(lane)))):
            if junction[begin]:
                wrong[begin:end] = False
            elif junction[begin - 1]:
                wrong[begin:end] = against[change]
            else:
                wrong[begin:end] = turned[change] and not wrong[begin - 1]


LANE_INFRACTIONS = InfractionMetric("lanes", find_lane_infractions)
