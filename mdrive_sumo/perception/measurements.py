"""Measurements of a tracker: boxes that one source reports, advanced to the present tick, and how far off they may be.

A position has two errors. One is new in every measurement. The other is a bias that stays: the errors of the estimated
poses of the sender and of the own car, by which everything that a message places is off. Own detections have no bias,
because they are in the world as the own estimate has it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, compress

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.contract.detector_profiles import DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.perception.tracking_parameters import TrackingParameters
from mdrive_sumo.v2x.messages import Cam, Cpm, ReferencePose

OWN_SENSOR = ""
STATIONS = "*"
"""Sources that are no station: what stations report of themselves is one list."""

Rows = npt.NDArray[np.void]
"""(N,) of `MEASUREMENT`, or of `track_states.TRACK`."""
MEASUREMENT = np.dtype(
    [
        ("source", "i8"),  # index of its source
        ("kind", "i8"),  # value of `Kind`
        ("x", "f8"),  # [m]
        ("y", "f8"),
        ("vx", "f8"),  # [m/s]
        ("vy", "f8"),
        ("yaw", "f8"),  # [rad]
        ("length", "f8"),  # [m]
        ("width", "f8"),
        ("position", "f8"),  # [m2] variance of x and of y, new in every measurement
        ("bias", "f8"),  # [m2] the same, constant over many measurements
        ("yaw_variance", "f8"),  # [rad2]
        ("speed_variance", "f8"),  # [m2/s2]
    ]
)


@dataclass(frozen=True, slots=True)
class Measurements:
    """Boxes of one or more sources at the present tick."""

    sources: tuple[str, ...]
    """Ids of stations, sorted; or `OWN_SENSOR`, or `STATIONS` for what stations report of themselves."""
    names: tuple[str, ...]
    """(N,) name that the source gives to each box."""
    rows: Rows
    """(N,) of `MEASUREMENT`, one source after the other."""

    def take(self, mask: Bool) -> "Measurements":
        """Return the measurements of a mask (N,)."""
        return Measurements(self.sources, tuple(compress(self.names, mask.tolist())), self.rows[mask])


@twin
def measure_detections(
    seen: Objects, own: OwnState, profile: DetectionProfile, elapsed_ticks: int, parameters: TrackingParameters, /
) -> Measurements:
    """Return own detections; elapsed_ticks: since the last measurement, which may have the same errors."""
    sigmas = np.empty((len(seen.ids), 3))
    sigmas[:, 0] = profile.spread_at(portable.hypot(seen.x - own.x, seen.y - own.y))
    sigmas[:, 1:] = profile.yaw_sigma, profile.speed_sigma
    variances = _compute_variances(sigmas, _count_repetitions(elapsed_ticks, parameters), parameters)
    age_s = np.full(len(seen.ids), profile.latency_ticks * DT)
    return Measurements((OWN_SENSOR,), seen.ids, _build_rows(seen, variances, 0.0 * age_s, age_s, 0.0, parameters))


@twin
def measure_stations(
    tick: int, stations: Sequence[tuple[str, Cam]], own: OwnState, parameters: TrackingParameters, /
) -> Measurements:
    """Return the senders of CAMs, by id, without those at the place of the own car or without a size."""
    cams = [cam for _, cam in stations]
    boxes = [(cam.pose.x, cam.pose.y, cam.pose.yaw, cam.speed, cam.length, cam.width) for cam in cams]
    columns = np.array(boxes, dtype=np.float64).reshape(-1, 6).T
    objects = Objects(tuple(name for name, _ in stations), np.full(len(cams), Kind.VEHICLE, dtype=np.uint8), *columns)
    age_s = np.array([(tick - cam.pose.tick) * DT for cam in cams])
    turn = np.array([cam.yaw_rate for cam in cams]) * age_s
    sigmas = np.array([(0.0, cam.pose.yaw_sigma, cam.speed_sigma) for cam in cams]).reshape(-1, 3)
    bias = portable.square(np.array([cam.pose.position_sigma for cam in cams])) + _compute_lever(objects, own)
    rows = _build_rows(objects, _compute_variances(sigmas, 1.0, parameters), bias, age_s, turn, parameters)
    return _select_others(Measurements((STATIONS,), objects.ids, rows), own, parameters)


@twin
def measure_reported(
    tick: int, reports: Sequence[tuple[str, Cpm, int]], own: OwnState, parameters: TrackingParameters, /
) -> Measurements:
    """Return the objects that stations detected, without those that are the own car or have no size.

    reports: station, its CPM, and the ticks since its last CPM in use; by station.
    """
    parts = [np.zeros(0, MEASUREMENT)]
    for i, (_, cpm, elapsed_ticks) in enumerate(reports):
        objects = cpm.objects
        sigmas = cpm.sigmas if len(cpm.sigmas) else np.zeros((len(objects.ids), 3))
        variances = _compute_variances(sigmas, _count_repetitions(elapsed_ticks, parameters), parameters)
        bias = _compute_lever(objects, cpm.pose) + _compute_lever(objects, own)
        age_s = (tick - cpm.pose.tick + cpm.age.astype(np.float64)) * DT
        part = _build_rows(objects, variances, bias, age_s, 0.0, parameters)
        part["source"] = i
        parts.append(part)
    names = tuple(chain.from_iterable(cpm.objects.ids for _, cpm, _ in reports))
    measurements = Measurements(tuple(name for name, _, _ in reports), names, np.concatenate(parts))
    return _select_others(measurements, own, parameters)


def _count_repetitions(elapsed_ticks: int, parameters: TrackingParameters) -> float:
    """Return how many successive measurements share their errors."""
    return max(1.0, parameters.correlation_ticks / max(elapsed_ticks, 1))


def _compute_variances(sigmas: Float, repetitions: float, parameters: TrackingParameters) -> Float:
    """Return the variances (3, N) of position, yaw and speed for sigmas (N, 3)."""
    floors = np.array((parameters.position_floor, parameters.yaw_floor, parameters.speed_floor))
    return (portable.square(sigmas) + portable.square(floors)).T * repetitions


def _compute_lever(objects: Objects, pose: OwnState | ReferencePose) -> Float:
    """Return the variance (N,) [m2] of each coordinate of points that are placed relative to an uncertain pose.

    An error of yaw moves a point across the line of sight only: by half of it in each coordinate, on average.
    """
    square = portable.square(objects.x - pose.x) + portable.square(objects.y - pose.y)
    return pose.position_sigma * pose.position_sigma + square * (pose.yaw_sigma * pose.yaw_sigma / 2)


def _build_rows(
    objects: Objects, variances: Float, bias: Float, age_s: Float, turn: Float | float, parameters: TrackingParameters
) -> Rows:
    """Return the measurements `age_s` (N,) [s] later, on arcs of `turn` [rad], as much less certain; of source 0."""
    position, yaw, speed = variances
    square = portable.square(age_s)
    later = objects.advance(age_s, turn)
    cos, sin = portable.cos_sin(later.yaw)
    rows = np.zeros(len(objects.ids), MEASUREMENT)
    for name in ("kind", "x", "y", "yaw", "length", "width"):
        rows[name] = getattr(later, name)
    rows["vx"], rows["vy"] = later.speed * cos, later.speed * sin
    rows["position"] = position + square * speed + portable.square(parameters.acceleration_sigma * square / 2)
    rows["bias"] = bias
    rows["yaw_variance"] = yaw
    rows["speed_variance"] = speed + portable.square(parameters.acceleration_sigma * age_s)
    return rows


def _select_others(new: Measurements, own: OwnState, parameters: TrackingParameters) -> Measurements:
    """Return the measurements of boxes that are not nearer to the own centre than another vehicle can be.

    A message may state a size of 0, of which no detection can be made.
    """
    rows = new.rows
    square = portable.square(rows["x"] - own.x) + portable.square(rows["y"] - own.y)
    is_far = square > parameters.own_radius_m * parameters.own_radius_m
    return new.take(is_far & (rows["length"] > 0.0) & (rows["width"] > 0.0))
