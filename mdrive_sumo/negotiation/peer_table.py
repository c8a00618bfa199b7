"""What a CAV knows of all others from their manoeuvre messages: one common view, made up for the messages' age."""

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.negotiation.intention import AFTER_S, INTERVAL_S, sample_polyline
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import MCM, Mcm, MessageError, decode

MEMORY_TICKS = TICKS_PER_SECOND
"""Who has not been heard for so long is forgotten."""


class PeerTable:
    """The latest MCM of every station, one's own included.

    Everybody sees himself as the others see him, by what he last announced: with a faultless channel all have the
    same view, and a rule applied to it gives the same result everywhere.
    """

    def __init__(self) -> None:
        self._latest: dict[str, tuple[int, Mcm]] = {}

    def receive(self, message: Message) -> bool:
        """Takes notice of a message; False if it is no readable MCM."""
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
        """The latest MCM of everybody who is not forgotten, sorted by station."""
        self._latest = {name: entry for name, entry in self._latest.items() if tick - entry[0] <= MEMORY_TICKS}
        return {name: self._latest[name][1] for name in sorted(self._latest)}

    def predict_members(self, tick: int) -> tuple[NegotiationMember, ...]:
        """Everybody who is not forgotten, as it should be now, sorted by station."""
        return tuple(
            _aged(name, mcm, self._age(name, mcm, tick) * DT) for name, mcm in self.get_latest_mcms(tick).items()
        )

    def _age(self, name: str, mcm: Mcm, tick: int) -> int:
        """Ticks since the sender was where its message says; who thinks for long says so late."""
        sent = self._latest[name][0]
        return max(tick - min(max(mcm.pose.tick, sent - MEMORY_TICKS), sent), 0)


def _aged(name: str, mcm: Mcm, age_s: float) -> NegotiationMember:
    """An announcement carried on by its age.

    The sender has driven what it planned; what it desires begins where that has brought it, so a car that waits still
    desires the same.
    """
    here = np.array((mcm.pose.x, mcm.pose.y))
    planned = _Motion(here, mcm.planned, mcm.interval_s)
    desired = _Motion(here, mcm.desired, mcm.interval_s) if len(mcm.desired) else planned
    driven = planned.travelled(np.full(1, age_s))
    now = planned.at(np.full(1, age_s))[0]
    later = planned.at(np.full(1, age_s + INTERVAL_S))[0] - now
    moves = float(np.hypot(*later)) > 0.1
    return NegotiationMember(
        id=name,
        x=float(now[0]),
        y=float(now[1]),
        yaw=float(np.arctan2(later[1], later[0])) if moves and age_s > 0 else mcm.pose.yaw,
        speed=float(np.hypot(*later)) / INTERVAL_S if age_s > 0 else mcm.speed,
        intention=mcm.intention,
        direction=mcm.direction,
        interval_s=INTERVAL_S,
        desired=desired.at(desired.when(float(driven[0]), age_s) + AFTER_S),
        planned=planned.at(age_s + AFTER_S),
    )


def predict_announced_poses(mcm: Mcm, age_s: float, after: Float) -> Float:
    """(T, 3) [m, m, rad] where the sender will be after so many seconds (T,), as it announced `age_s` ago."""
    planned = _Motion(np.array((mcm.pose.x, mcm.pose.y)), mcm.planned, mcm.interval_s)
    xy, ahead = planned.at(age_s + after), planned.at(age_s + after + INTERVAL_S)
    steps = ahead - xy
    moves = np.hypot(steps[:, 0], steps[:, 1]) > 0.05
    yaw = np.where(moves, np.arctan2(steps[:, 1], steps[:, 0]), np.nan)
    return np.column_stack((xy, _filled(yaw, mcm.pose.yaw)))


def _filled(yaw: Float, first: float) -> Float:
    """Directions of a car that stands at times: those it had before."""
    known = ~np.isnan(yaw)
    last = np.maximum.accumulate(np.where(known, np.arange(len(yaw)), -1))
    return np.where(last >= 0, yaw[np.maximum(last, 0)], first)


class _Motion:
    """A trajectory in time: where one is after t seconds, going on at the last speed beyond its end."""

    def __init__(self, here: Float, points: Float, interval_s: float) -> None:
        self._way = np.vstack((here, points))
        steps = np.diff(self._way, axis=0)
        self._s = np.concatenate(((0.0,), np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))))
        self._times = np.arange(len(self._way)) * interval_s
        self._last_speed = (self._s[-1] - self._s[-2]) / interval_s if len(points) else 0.0

    def travelled(self, t: Float) -> Float:
        """Arc length (N,) [m] at times (N,) [s]."""
        beyond = np.maximum(t - self._times[-1], 0.0)
        return np.interp(t, self._times, self._s) + self._last_speed * beyond

    def at(self, t: Float) -> Float:
        """Points (N, 2) [m] at times (N,) [s]."""
        return (
            sample_polyline(self._way, self.travelled(t))
            if len(self._way) > 1
            else np.repeat(self._way, len(t), axis=0)
        )

    def when(self, s: float, latest: float) -> float:
        """The first time [s] at which arc length s [m] is reached, at most the latest [s]."""
        reached = int(np.searchsorted(self._s, s - 1e-9))
        if reached == 0 or reached >= len(self._s):
            return min(latest, self._times[-1]) if reached else 0.0
        share = (s - self._s[reached - 1]) / (self._s[reached] - self._s[reached - 1])
        return min(float(self._times[reached - 1] + share * (self._times[1] - self._times[0])), latest)
