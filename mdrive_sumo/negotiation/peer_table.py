"""A CAV's knowledge of all members from their MCMs: one common view, compensated for the age of the messages."""

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.negotiation.intention import AFTER_S, INTERVAL_S, MeasuredLine
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import MCM, Mcm, MessageError, decode

MEMORY_TICKS = TICKS_PER_SECOND
"""A station that has been silent for longer is dropped."""


class PeerTable:
    """The latest MCM of every station, the own one included.

    Every CAV sees itself as the others see it, by its last announcement: over a perfect channel all CAVs have the same
    view, and a rule applied to it gives the same result everywhere.
    """

    def __init__(self) -> None:
        self._latest: dict[str, tuple[int, Mcm]] = {}

    def receive(self, message: Message) -> bool:
        """Store an MCM; return False if the message is no readable MCM."""
        if message.type != MCM:
            return False
        try:
            mcm = decode(message)
        except MessageError:
            return False
        if isinstance(mcm, Mcm) and message.tick >= self._latest.get(message.sender, (-1, mcm))[0]:
            self._latest[message.sender] = message.tick, mcm
        return True

    def get_latest_mcms(self, tick: int) -> dict[str, Mcm]:
        """Return the latest MCM by station, sorted by station, without stations that have been silent for too long."""
        self._latest = {name: entry for name, entry in self._latest.items() if tick - entry[0] <= MEMORY_TICKS}
        return {name: self._latest[name][1] for name in sorted(self._latest)}

    def predict_members(self, tick: int) -> tuple[NegotiationMember, ...]:
        """Return all members as they should be at that tick, sorted by station."""
        mcms = self.get_latest_mcms(tick)
        return tuple(_predict_member(name, mcm, self._compute_age(name, mcm, tick) * DT) for name, mcm in mcms.items())

    def _compute_age(self, name: str, mcm: Mcm, tick: int) -> int:
        """Return the ticks since the sender was at the position in its message; a slow agent sends late."""
        sent = self._latest[name][0]
        return max(tick - min(max(mcm.pose.tick, sent - MEMORY_TICKS), sent), 0)


def _predict_member(name: str, mcm: Mcm, age_s: float) -> NegotiationMember:
    """Return the member that an MCM describes, `age_s` [s] later.

    The sender has driven what it planned. Its desired trajectory starts from there, so a waiting car still desires the
    same.
    """
    here = np.array((mcm.pose.x, mcm.pose.y))
    planned = _AnnouncedTrajectory(here, mcm.planned, mcm.interval_s)
    desired = _AnnouncedTrajectory(here, mcm.desired, mcm.interval_s) if len(mcm.desired) else planned
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
        desired=desired.get_points(desired.find_time(float(driven[0]), age_s) + AFTER_S),
        planned=planned.get_points(age_s + AFTER_S),
    )


def predict_announced_poses(mcm: Mcm, age_s: float, after: Float) -> Float:
    """Return the poses (T, 3) [m, m, rad] of the sender at times `after` (T,) [s], announced `age_s` ago."""
    planned = _AnnouncedTrajectory(np.array((mcm.pose.x, mcm.pose.y)), mcm.planned, mcm.interval_s)
    xy, ahead = planned.get_points(age_s + after), planned.get_points(age_s + after + INTERVAL_S)
    steps = ahead - xy
    is_moving = portable.hypot(steps[:, 0], steps[:, 1]) > 0.05
    yaw = np.where(is_moving, portable.atan2(steps[:, 1], steps[:, 0]), np.nan)
    return np.column_stack((xy, _fill_forward(yaw, mcm.pose.yaw)))


def _fill_forward(yaw: Float, first: float) -> Float:
    """Return the headings with NaN (the car stands) replaced by the previous heading."""
    known = ~np.isnan(yaw)
    last = np.maximum.accumulate(np.where(known, np.arange(len(yaw)), -1))
    return np.where(last >= 0, yaw[np.maximum(last, 0)], first)


class _AnnouncedTrajectory:
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
