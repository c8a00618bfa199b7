"""What an MCM announces, as it should be some time later.

All CAVs that received the same bytes predict the same, so predictions are cached by payload and age. The arrays of all
results are read-only, because callers share them.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.negotiation.intention import AFTER_S, INTERVAL_S, MeasuredLine
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.planning.motion_prediction import TIMES, predict_yielding
from mdrive_sumo.v2x.messages import MCM, Mcm
from mdrive_sumo.v2x.shared_reading import decode_payload

CACHED_ANNOUNCEMENTS, CACHED_PREDICTIONS = 256, 1024
"""More than 12 CAVs announce and predict in the second for which announcements are kept."""


@dataclass(frozen=True, slots=True)
class Announcement:
    """An MCM with its trajectories measured."""

    mcm: Mcm
    planned: "AnnouncedTrajectory"
    desired: "AnnouncedTrajectory"


@lru_cache(maxsize=CACHED_ANNOUNCEMENTS)
def read_announcement(payload: bytes) -> Announcement:
    """Return the announcement of a readable MCM."""
    mcm = decode_payload(MCM, payload)
    assert isinstance(mcm, Mcm), "a peer table stores readable MCMs only"
    here = np.array((mcm.pose.x, mcm.pose.y))
    planned = AnnouncedTrajectory(here, mcm.planned, mcm.interval_s)
    desired = AnnouncedTrajectory(here, mcm.desired, mcm.interval_s) if len(mcm.desired) else planned
    return Announcement(mcm, planned, desired)


@lru_cache(maxsize=CACHED_PREDICTIONS)
def predict_announced_member(name: str, payload: bytes, age_ticks: int) -> NegotiationMember:
    """Return the member that an MCM describes, `age_ticks` later.

    The sender has driven what it planned. Its desired trajectory starts from there, so a waiting car still desires the
    same.
    """
    announced, age_s = read_announcement(payload), age_ticks * DT
    mcm, planned = announced.mcm, announced.planned
    driven = planned.compute_travelled(np.full(1, age_s))
    now = planned.get_points(np.full(1, age_s))[0]
    later = planned.get_points(np.full(1, age_s + INTERVAL_S))[0] - now
    is_moving = float(portable.hypot(*later)) > 0.1
    return NegotiationMember(
        id=name,
        x=float(now[0]),
        y=float(now[1]),
        yaw=float(portable.atan2(later[1], later[0])) if is_moving and age_s > 0 else mcm.pose.yaw,
        speed=float(portable.hypot(*later)) / INTERVAL_S if age_s > 0 else mcm.speed,
        intention=mcm.intention,
        direction=mcm.direction,
        interval_s=INTERVAL_S,
        desired=_freeze(announced.desired.get_points(announced.desired.find_time(float(driven[0]), age_s) + AFTER_S)),
        planned=_freeze(planned.get_points(age_s + AFTER_S)),
    )


@lru_cache(maxsize=CACHED_PREDICTIONS)
def predict_announced_poses(payload: bytes, age_ticks: int) -> Float:
    """Return the poses (T, 3) [m, m, rad] of the sender of an MCM at `TIMES`, announced `age_ticks` ago."""
    announced, age_s = read_announcement(payload), age_ticks * DT
    planned = announced.planned
    xy, ahead = planned.get_points(age_s + TIMES), planned.get_points(age_s + TIMES + INTERVAL_S)
    steps = ahead - xy
    is_moving = portable.hypot(steps[:, 0], steps[:, 1]) > 0.05
    yaw = np.where(is_moving, portable.atan2(steps[:, 1], steps[:, 0]), np.nan)
    return _freeze(np.column_stack((xy, _fill_forward(yaw, announced.mcm.pose.yaw))))


@lru_cache(maxsize=CACHED_PREDICTIONS)
def predict_announced_braking(payload: bytes, age_ticks: int) -> Float:
    """Return the poses (T, 3) along the announced line of a sender that brakes for the own car from now on."""
    poses = predict_announced_poses(payload, age_ticks)
    steps = portable.hypot(*np.diff(poses[:, :2], axis=0).T)
    s = np.concatenate(((0.0,), np.cumsum(steps)))
    travelled = predict_yielding(read_announcement(payload).mcm.speed)
    braked = np.minimum(travelled - float(travelled[0]), s)
    yaw = np.unwrap(poses[:, 2])
    return _freeze(np.column_stack([np.interp(braked, s, column) for column in (poses[:, 0], poses[:, 1], yaw)]))


def _freeze(array: Float) -> Float:
    array.setflags(write=False)
    return array


def _fill_forward(yaw: Float, first: float) -> Float:
    """Return the headings with NaN (the car stands) replaced by the previous heading."""
    known = ~np.isnan(yaw)
    last = np.maximum.accumulate(np.where(known, np.arange(len(yaw)), -1))
    return np.where(last >= 0, yaw[np.maximum(last, 0)], first)


class AnnouncedTrajectory:
    """A trajectory from a position through points at a fixed interval; beyond its end at the last speed."""

    def __init__(self, here: Float, points: Float, interval_s: float) -> None:
        line = np.vstack((here, points))
        self._line, self._start, self._is_standing = MeasuredLine(line), line[:1], len(line) == 1
        self._s = self._line.s
        self._times = np.arange(len(line)) * interval_s
        self._last_speed = (self._s[-1] - self._s[-2]) / interval_s if len(points) else 0.0

    def compute_travelled(self, t: Float) -> Float:
        """Return the arc length (N,) [m] at times (N,) [s]."""
        beyond = np.maximum(t - self._times[-1], 0.0)
        return np.interp(t, self._times, self._s) + self._last_speed * beyond

    def get_points(self, t: Float) -> Float:
        """Return the points (N, 2) [m] at times (N,) [s]."""
        if self._is_standing:
            return np.repeat(self._start, len(t), axis=0)
        return self._line.sample(self.compute_travelled(t))

    def find_time(self, s: float, latest: float) -> float:
        """Return the first time [s] at which arc length s [m] is reached, at most `latest` [s]."""
        reached = int(np.searchsorted(self._s, s - 1e-9))
        if reached == 0 or reached >= len(self._s):
            return min(latest, self._times[-1]) if reached else 0.0
        share = (s - self._s[reached - 1]) / (self._s[reached] - self._s[reached - 1])
        return min(float(self._times[reached - 1] + share * (self._times[1] - self._times[0])), latest)
