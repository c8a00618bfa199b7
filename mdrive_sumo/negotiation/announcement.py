"""What an MCM announces, as it should be some time later.

All CAVs that received the same bytes predict the same, so predictions are cached by payload and age. The arrays of all
results are read-only, because callers share them.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.negotiation.intention import AFTER_S, INTERVAL_S, MeasuredLine, measure_line, sample_line
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.planning.motion_prediction import TIMES, predict_yielding
from mdrive_sumo.v2x.messages import MCM, Mcm
from mdrive_sumo.v2x.shared_reading import decode_payload

CACHED_ANNOUNCEMENTS, CACHED_PREDICTIONS = 256, 1024
"""More than 12 CAVs announce and predict in the second for which announcements are kept."""


@dataclass(frozen=True, slots=True)
class AnnouncedTrajectory:
    """A trajectory from a position through points at a fixed interval; beyond its end at the last speed."""

    line: MeasuredLine
    """Through the position and K points."""
    times: Float
    """(K + 1,) [s] at the points of the line."""
    last_speed: float
    """[m/s] Of the last step; 0 if there is none."""

    def compute_travelled(self, t: Float) -> Float:
        """Return the arc length (N,) [m] at times (N,) [s]."""
        beyond = np.maximum(t - self.times[-1], 0.0)
        return np.interp(t, self.times, self.line.s) + self.last_speed * beyond

    def get_points(self, t: Float) -> Float:
        """Return the points (N, 2) [m] at times (N,) [s]."""
        if len(self.times) == 1:
            return np.repeat(self.line.points, len(t), axis=0)
        return sample_line(self.line, self.compute_travelled(t))

    def find_time(self, s: float, latest: float) -> float:
        """Return the first time [s] at which arc length s [m] is reached, at most `latest` [s]."""
        reached, stations = int(np.searchsorted(self.line.s, s - 1e-9)), self.line.s
        if reached == 0 or reached >= len(stations):
            return min(latest, float(self.times[-1])) if reached else 0.0
        share = (s - stations[reached - 1]) / (stations[reached] - stations[reached - 1])
        return min(float(self.times[reached - 1] + share * (self.times[1] - self.times[0])), latest)


@dataclass(frozen=True, slots=True)
class Announcement:
    """An MCM with its trajectories measured."""

    mcm: Mcm
    planned: AnnouncedTrajectory
    desired: AnnouncedTrajectory


@lru_cache(maxsize=CACHED_ANNOUNCEMENTS)
def read_announcement(payload: bytes) -> Announcement:
    """Return the announcement of a readable MCM."""
    mcm = decode_payload(MCM, payload)
    assert isinstance(mcm, Mcm), "a peer table stores readable MCMs only"
    here = mcm.pose.x, mcm.pose.y
    planned = measure_trajectory(here, mcm.planned, mcm.interval_s)
    desired = measure_trajectory(here, mcm.desired, mcm.interval_s) if len(mcm.desired) else planned
    return Announcement(mcm, planned, desired)


@lru_cache(maxsize=CACHED_PREDICTIONS)
def predict_announced_member(name: str, payload: bytes, age_ticks: int) -> NegotiationMember:
    """Return the member that an MCM describes, `age_ticks` later.

    The sender has driven what it planned. Its desired trajectory starts from there, so a waiting car still desires the
    same.
    """
    member = predict_member(name, read_announcement(payload), age_ticks * DT)
    _freeze(member.desired)
    _freeze(member.planned)
    return member


@lru_cache(maxsize=CACHED_PREDICTIONS)
def predict_announced_poses(payload: bytes, age_ticks: int) -> Float:
    """Return the poses (T, 3) [m, m, rad] of the sender of an MCM at `TIMES`, announced `age_ticks` ago."""
    announced = read_announcement(payload)
    return _freeze(predict_poses(announced.planned, age_ticks * DT, announced.mcm.pose.yaw))


@lru_cache(maxsize=CACHED_PREDICTIONS)
def predict_announced_braking(payload: bytes, age_ticks: int) -> Float:
    """Return the poses (T, 3) along the announced line of a sender that brakes for the own car from now on."""
    speed = read_announcement(payload).mcm.speed
    return _freeze(predict_braking(predict_announced_poses(payload, age_ticks), speed))


def _freeze(array: Float) -> Float:
    array.setflags(write=False)
    return array


@twin
def measure_trajectory(here: tuple[float, float], points: Float, interval_s: float, /) -> AnnouncedTrajectory:
    """Return the trajectory from a position [m] through points (K, 2) [m] every `interval_s`."""
    line = measure_line(np.vstack((here, points)))
    last_speed = float((line.s[-1] - line.s[-2]) / interval_s) if len(points) else 0.0
    return AnnouncedTrajectory(line, np.arange(float(len(line.s))) * interval_s, last_speed)


@twin
def predict_member(name: str, announced: Announcement, age_s: float, /) -> NegotiationMember:
    """As `predict_announced_member`."""
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
        desired=announced.desired.get_points(announced.desired.find_time(float(driven[0]), age_s) + AFTER_S),
        planned=planned.get_points(age_s + AFTER_S),
    )


@twin
def predict_poses(trajectory: AnnouncedTrajectory, age_s: float, yaw: float, /) -> Float:
    """As `predict_announced_poses`; yaw: heading [rad] of a car that has not moved yet."""
    xy, ahead = trajectory.get_points(age_s + TIMES), trajectory.get_points(age_s + TIMES + INTERVAL_S)
    headings: list[float] = []
    for dx, dy in (ahead - xy).tolist():
        if portable.hypot(dx, dy) > 0.05:
            yaw = portable.atan2(dy, dx)
        headings.append(yaw)
    return np.column_stack((xy, headings))


@twin
def predict_braking(poses: Float, speed: float, /) -> Float:
    """As `predict_announced_braking`; poses: (T, 3) announced; speed: [m/s] now."""
    steps = portable.hypot(*np.diff(poses[:, :2], axis=0).T)
    s = np.concatenate(((0.0,), np.cumsum(steps)))
    travelled = predict_yielding(speed)
    braked = np.minimum(travelled - float(travelled[0]), s)
    yaw = np.unwrap(poses[:, 2])
    return np.column_stack([np.interp(braked, s, column) for column in (poses[:, 0], poses[:, 1], yaw)])
