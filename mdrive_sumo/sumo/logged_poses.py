"""Vehicles that repeat their log: poses of every tick, and who is still on them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT, Actors, Kind
from mdrive_sumo.scenario.background import BackgroundVehicle


@dataclass(frozen=True, slots=True)
class LogPose:
    """Box centre [m], yaw [rad], speed along it [m/s]."""

    x: float
    y: float
    yaw: float
    speed: float


@dataclass(frozen=True, slots=True, eq=False)
class Logs:
    """Poses of V vehicles in the ticks 0 to K-1, linear between those of the log."""

    vehicles: tuple[BackgroundVehicle, ...]
    """Sorted by id."""
    poses: Float
    """(V, K, 4): x, y [m], yaw [rad], speed along yaw [m/s]."""
    present: Bool
    """(V, K): from the first to the last time of its log."""
    size: Float
    """(V, 2): length and width [m]."""

    def pose(self, vehicle: BackgroundVehicle, tick: int) -> LogPose | None:
        """Where its log has a vehicle in a tick; None where it does not have it."""
        i = self.vehicles.index(vehicle)
        if not 0 <= tick < self.present.shape[1] or not self.present[i, tick]:
            return None
        return LogPose(*self.poses[i, tick].tolist())

    def actors(self, tick: int, chosen: Bool) -> Actors:
        """Those of the `chosen` vehicles (V,) that are there in a tick."""
        if not len(self.vehicles) or tick >= self.present.shape[1]:
            return Actors.empty()
        there = np.flatnonzero(chosen & self.present[:, tick])
        x, y, yaw, speed = self.poses[there, tick].T
        ids = tuple(self.vehicles[i].id for i in there)
        kind = np.full(len(ids), Kind.VEHICLE, dtype=np.uint8)
        return Actors(ids, kind, x, y, yaw, speed, self.size[there, 0], self.size[there, 1])


def logs_of(vehicles: Iterable[BackgroundVehicle]) -> Logs:
    """The logs of those vehicles that have one."""
    chosen = tuple(sorted((vehicle for vehicle in vehicles if vehicle.log), key=lambda vehicle: vehicle.id))
    ticks = max((round(vehicle.log[-1][0] / DT) + 1 for vehicle in chosen), default=0)
    poses, present = np.zeros((len(chosen), ticks, 4)), np.zeros((len(chosen), ticks), dtype=np.bool_)
    for i, vehicle in enumerate(chosen):
        poses[i], present[i] = _sampled(np.array(vehicle.log), ticks)
    return Logs(chosen, poses, present, np.array([(v.length, v.width) for v in chosen]).reshape(-1, 2))


def _sampled(log: Float, ticks: int) -> tuple[Float, Bool]:
    """Poses (K, 4) of one log (N, 4: time, x, y, yaw) at every tick, and when it is there (K,)."""
    times, now = log[:, 0], np.arange(ticks) * DT
    yaw = np.unwrap(log[:, 3])
    x, y, heading = (np.interp(now, times, column) for column in (log[:, 1], log[:, 2], yaw))
    speed = np.interp(now, times, _speeds(times, log[:, 1], log[:, 2], yaw))
    there = (now > times[0] - 1e-6) & (now < times[-1] + 1e-6)
    return np.stack((x, y, heading, speed), axis=1), there


def _speeds(times: Float, x: Float, y: Float, yaw: Float) -> Float:
    """Speed (N,) [m/s] along the heading at the poses of a log."""
    if len(times) < 2:
        return np.zeros(len(times))
    return np.gradient(x, times) * np.cos(yaw) + np.gradient(y, times) * np.sin(yaw)
