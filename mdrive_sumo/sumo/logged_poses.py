"""Logged poses of background vehicles, interpolated to ticks."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT, Actors, Kind
from mdrive_sumo.scenario.background import BackgroundVehicle


@dataclass(frozen=True, slots=True)
class LoggedPose:
    """Box centre [m], yaw [rad], speed along it [m/s]."""

    x: float
    y: float
    yaw: float
    speed: float


@dataclass(frozen=True, slots=True, eq=False)
class LoggedPoses:
    """Poses of V vehicles in the ticks 0 to K - 1, interpolated linearly."""

    vehicles: tuple[BackgroundVehicle, ...]
    """Sorted by id."""
    poses: Float
    """(V, K, 4): x, y [m], yaw [rad], speed along yaw [m/s]."""
    present: Bool
    """(V, K): whether the tick lies within the log of the vehicle."""
    dimensions: Float
    """(V, 2): length and width [m]."""

    def find_pose(self, vehicle: BackgroundVehicle, tick: int) -> LoggedPose | None:
        """Return the logged pose of a vehicle in a tick; None outside its log."""
        i = self.vehicles.index(vehicle)
        if not 0 <= tick < self.present.shape[1] or not self.present[i, tick]:
            return None
        return LoggedPose(*self.poses[i, tick].tolist())

    def actors(self, tick: int, chosen: Bool) -> Actors:
        """Return those of the `chosen` vehicles (V,) that are present in a tick."""
        if not len(self.vehicles) or tick >= self.present.shape[1]:
            return Actors.empty()
        there = np.flatnonzero(chosen & self.present[:, tick])
        x, y, yaw, speed = self.poses[there, tick].T
        ids = tuple(self.vehicles[i].id for i in there)
        kind = np.full(len(ids), Kind.VEHICLE, dtype=np.uint8)
        return Actors(ids, kind, x, y, yaw, speed, self.dimensions[there, 0], self.dimensions[there, 1])


def build_logged_poses(vehicles: Iterable[BackgroundVehicle]) -> LoggedPoses:
    """Return the poses of the vehicles that have a log."""
    chosen = tuple(sorted((vehicle for vehicle in vehicles if vehicle.log), key=lambda vehicle: vehicle.id))
    ticks = max((round(vehicle.log[-1][0] / DT) + 1 for vehicle in chosen), default=0)
    poses, present = np.zeros((len(chosen), ticks, 4)), np.zeros((len(chosen), ticks), dtype=np.bool_)
    for i, vehicle in enumerate(chosen):
        poses[i], present[i] = _resample(np.array(vehicle.log), ticks)
    return LoggedPoses(chosen, poses, present, np.array([(v.length, v.width) for v in chosen]).reshape(-1, 2))


def _resample(log: Float, ticks: int) -> tuple[Float, Bool]:
    """Return the poses (K, 4) of one log (N, 4: time, x, y, yaw) at every tick, and its presence (K,)."""
    times, now = log[:, 0], np.arange(ticks) * DT
    yaw = np.unwrap(log[:, 3])
    x, y, heading = (np.interp(now, times, column) for column in (log[:, 1], log[:, 2], yaw))
    speed = np.interp(now, times, _compute_speeds(times, log[:, 1], log[:, 2], yaw))
    there = (now > times[0] - 1e-6) & (now < times[-1] + 1e-6)
    return np.stack((x, y, heading, speed), axis=1), there


def _compute_speeds(times: Float, x: Float, y: Float, yaw: Float) -> Float:
    """Return the speed (N,) [m/s] along the heading at the poses of a log."""
    if len(times) < 2:
        return np.zeros(len(times))
    cos, sin = portable.cos_sin(yaw)
    return np.gradient(x, times) * cos + np.gradient(y, times) * sin
