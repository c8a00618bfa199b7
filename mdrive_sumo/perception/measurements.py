"""Measurements of a tracker: boxes that one source reports, advanced to the present tick, and how far off they may be.

A position has two errors. One is new in every measurement. The other is a bias that stays: the errors of the estimated
poses of the sender and of the own car, by which everything that a message places is off. Own detections have no bias,
because they are in the world as the own estimate has it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain, compress

import numpy as np

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.contract.detector_profiles import DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.perception.tracking_parameters import TRACKING, TrackingParameters
from mdrive_sumo.v2x.messages import Cam, Cpm

OWN_SENSOR = ""
STATIONS = "*"
"""Sources that are no station: what stations report of themselves is one list."""


@dataclass(frozen=True, slots=True)
class Measurements:
    """Boxes of one or more sources at the present tick; all arrays are (N,) variances."""

    sources: tuple[str, ...]
    """(N,) id of the station; or `OWN_SENSOR`, or `STATIONS` for what stations report of themselves. Sorted."""
    objects: Objects
    position: Float
    """[m2] Of each position coordinate, new in every measurement."""
    bias: Float
    """[m2] The same, constant over many measurements."""
    yaw: Float
    """[rad2]"""
    speed: Float
    """[m2/s2]"""

    @classmethod
    def empty(cls) -> "Measurements":
        """Return no measurements."""
        return cls((), Objects.empty(), *(np.zeros(0) for _ in range(4)))

    def take(self, mask: Bool) -> "Measurements":
        """Return the measurements of a mask (N,)."""
        columns = (self.position[mask], self.bias[mask], self.yaw[mask], self.speed[mask])
        return Measurements(tuple(compress(self.sources, mask)), self.objects.take(mask), *columns)

    def exclude_near(self, own: OwnState, radius_m: float) -> "Measurements":
        """Return the measurements further than `radius_m` from the own centre."""
        far = portable.square(self.objects.x - own.x) + portable.square(self.objects.y - own.y) > radius_m * radius_m
        return self if far.all() else self.take(far)


def measure_detections(
    seen: Objects,
    own: OwnState,
    profile: DetectionProfile,
    elapsed_ticks: int,
    parameters: TrackingParameters = TRACKING,
) -> Measurements:
    """Return own detections; elapsed_ticks: since the last measurement, which may have the same errors."""
    spread = profile.spread_at(portable.hypot(seen.x - own.x, seen.y - own.y))
    same = np.full(len(seen.ids), 1.0)
    age_s = np.full(len(seen.ids), profile.latency_ticks * DT)
    sigmas = np.column_stack((spread, profile.yaw_sigma * same, profile.speed_sigma * same))
    position, yaw, speed = _to_variances(sigmas, _count_repetitions(elapsed_ticks, parameters), parameters)
    sources = (OWN_SENSOR,) * len(seen.ids)
    return _advance(Measurements(sources, seen, position, 0.0 * same, yaw, speed), age_s, 0.0, parameters)


def measure_stations(
    tick: int, cam_by_station: Mapping[str, Cam], own: OwnState, parameters: TrackingParameters = TRACKING
) -> Measurements:
    """Return the senders of CAMs."""
    names = sorted(cam_by_station)
    cams = [cam_by_station[name] for name in names]
    rows = [(cam.pose.x, cam.pose.y, cam.pose.yaw, cam.speed, cam.length, cam.width) for cam in cams]
    columns = np.array(rows, dtype=np.float64).reshape(-1, 6).T
    objects = Objects(tuple(names), np.full(len(names), Kind.VEHICLE, dtype=np.uint8), *columns)
    age_s = np.array([(tick - cam.pose.tick) * DT for cam in cams])
    turn = np.array([cam.yaw_rate for cam in cams]) * age_s
    sigmas = np.array([(0.0, cam.pose.yaw_sigma, cam.speed_sigma) for cam in cams]).reshape(-1, 3)
    sent = portable.square(np.array([cam.pose.position_sigma for cam in cams]))
    bias = sent + _compute_own_bias(objects, own)
    position, yaw, speed = _to_variances(sigmas, 1.0, parameters)
    sources = (STATIONS,) * len(names)
    return _advance(Measurements(sources, objects, position, bias, yaw, speed), age_s, turn, parameters)


def measure_reported(
    tick: int,
    cpm_by_station: Mapping[str, Cpm],
    own: OwnState,
    elapsed_by_station: Mapping[str, int],
    parameters: TrackingParameters = TRACKING,
) -> Measurements:
    """Return the objects that stations detected, by station; elapsed_by_station: ticks since its last CPM in use."""
    names = sorted(cpm_by_station)
    cpms = [cpm_by_station[name] for name in names]
    counts = [len(cpm.objects.ids) for cpm in cpms]
    of = np.repeat(np.arange(len(cpms)), counts)
    objects = cpms[0].objects.concat(*(cpm.objects for cpm in cpms[1:]))
    poses = np.array([(p.x, p.y, p.position_sigma, p.yaw_sigma) for p in (cpm.pose for cpm in cpms)])[of]
    age_ticks = np.concatenate([tick - cpm.pose.tick + cpm.age.astype(np.float64) for cpm in cpms])
    sigmas = np.concatenate(
        [cpm.sigmas if len(cpm.sigmas) else np.zeros((count, 3)) for cpm, count in zip(cpms, counts, strict=True)]
    )
    times = np.array([_count_repetitions(elapsed_by_station[name], parameters) for name in names])[of]
    bias = _compute_lever(objects, *poses.T) + _compute_own_bias(objects, own)
    position, yaw, speed = _to_variances(sigmas, times, parameters)
    sources = tuple(chain.from_iterable((name,) * count for name, count in zip(names, counts, strict=True)))
    measurements = Measurements(sources, replace(objects, free_m=np.zeros(0)), position, bias, yaw, speed)
    return _advance(measurements, age_ticks * DT, 0.0, parameters)


def _count_repetitions(elapsed_ticks: int, parameters: TrackingParameters) -> float:
    """Return how many successive measurements share their errors."""
    return max(1.0, parameters.correlation_ticks / max(elapsed_ticks, 1))


def _compute_own_bias(objects: Objects, own: OwnState) -> Float:
    """Return the position variance (N,) [m2] of the own estimated frame at the objects."""
    return _compute_lever(objects, own.x, own.y, own.position_sigma, own.yaw_sigma)


def _compute_lever(
    objects: Objects, x: Float | float, y: Float | float, position_sigma: Float | float, yaw_sigma: Float | float
) -> Float:
    """Return the variance (N,) [m2] of each coordinate of points seen from uncertain poses, one for all or (N,).

    An error of yaw moves a point across the line of sight only: by half of it in each coordinate, on average.
    """
    square = portable.square(objects.x - x) + portable.square(objects.y - y)
    return position_sigma * position_sigma + square * (yaw_sigma * yaw_sigma / 2)


def _to_variances(sigmas: Float, times: Float | float, parameters: TrackingParameters) -> tuple[Float, Float, Float]:
    """Return the variances (N,) of position, yaw and speed for sigmas (N, 3) of which `times` in a row are the same."""
    floors = np.array((parameters.position_floor, parameters.yaw_floor, parameters.speed_floor))
    position, yaw, speed = (portable.square(sigmas) + portable.square(floors)).T * times
    return position, yaw, speed


def _advance(new: Measurements, age_s: Float, turn: Float | float, parameters: TrackingParameters) -> Measurements:
    """Return the measurements `age_s` (N,) [s] later, on arcs of `turn` [rad], as much less certain."""
    square = portable.square(age_s)
    return replace(
        new,
        objects=new.objects.advance(age_s, turn),
        position=new.position + square * new.speed + portable.square(parameters.acceleration_sigma * square / 2),
        speed=new.speed + portable.square(parameters.acceleration_sigma * age_s),
    )
