"""Which detections a station's next CPM has: the inclusion rules of ETSI TS 103 324 V2.1.1, section 6.1.2.

Left out: redundancy mitigation (annex G, optional), and perception regions beyond the free sight.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import DetectionProfile
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.v2x.services.motion_thresholds import (
    MAX_INTERVAL_TICKS,
    MIN_INTERVAL_TICKS,
    MOTION_THRESHOLDS,
    MotionThresholds,
)


@dataclass(frozen=True, slots=True)
class CpmGeneration:
    """Parameters of `CpmRule`; sections of TS 103 324 V2.1.1."""

    thresholds: MotionThresholds = MOTION_THRESHOLDS
    min_ticks: int = MIN_INTERVAL_TICKS
    """T_GenCpmMin (6.1.2)."""
    max_ticks: int = MAX_INTERVAL_TICKS
    """T_GenCpmMax: each vehicle and static object is included at least this often (6.1.2)."""
    group_ticks: int = MAX_INTERVAL_TICKS // 2
    """T_GenCpmMax / 2: one pedestrian or cyclist that was not included for this long, and all are (6.1.2, type A)."""
    sensor_ticks: int = TICKS_PER_SECOND
    """T_AddSensorInformation: range and free sight of the sensor (6.1.2)."""
    sigmas: float = 2.0
    """A change counts if it also exceeds so many standard deviations of what the detector's errors feign: without that
    a standing car with a speed error of 0.5 m/s is included in every second CPM. Ours; none for exact detectors."""
    confirmation_ticks: int = TICKS_PER_SECOND // 2 + 1
    """A detection is told of once it is no false positive: those last half a second (docs/detections.md). Ours, for the
    least confidence of an object that the standard leaves to the station."""
    moving_speed: float = 1.0
    """[m/s] A faster object is no false positive if it was detected twice: those stand. Ours."""
    warm_ticks: int = TICKS_PER_SECOND
    """Detections of the first second are told of at once: in traffic a station has run before. Ours, as of trackers."""
    forget_ticks: int = 2 * TICKS_PER_SECOND
    """An object that was not detected for this long is new if it returns. Ours, as of trackers."""


CPM_GENERATION = CpmGeneration()


class _Included(NamedTuple):
    """An object as the last CPM with it had it."""

    tick: float
    x: float
    y: float
    yaw: float
    speed: float


NEVER = _Included(-math.inf, 0.0, 0.0, 0.0, 0.0)
"""Of an object that no CPM has had: infinitely long ago."""
BELOW_ONE = 0.999
"""Of a change that only equals its threshold: the standard asks for more than that."""


@dataclass(slots=True)
class _Sighting:
    """The detections of one object."""

    first_tick: int
    last_tick: int
    is_confirmed: bool
    included: _Included | None = None


@dataclass(frozen=True, slots=True)
class DueCpm:
    """A CPM that is to be sent."""

    rows: Int
    """(N,) rows of the objects to include, the most useful first."""
    has_sensor_information: bool
    """Whether it has the free sight of the sensor."""


class CpmRule:
    """The CPMs of one station, a CAV or a road-side unit. Ask it in every 100 ms at least."""

    def __init__(self, profile: DetectionProfile, parameters: CpmGeneration = CPM_GENERATION) -> None:
        """profile: errors of the detector."""
        self._parameters, self._is_exact = parameters, not profile.false_positives
        self._least_changes = _compute_least_changes(profile, parameters)
        self._sightings: dict[str, _Sighting] = {}
        self._sent_tick: int | None = None
        """Tick of the last CPM."""
        self._sensor_tick: int | None = None
        """Tick of the last CPM with the free sight."""

    def check(self, tick: int, objects: Objects, capacity: int, dcc_ticks: int = 0) -> DueCpm | None:
        """Return the CPM that is to be sent in this tick, which then counts as sent; None if none is due.

        objects: the detections of this tick, nearest first. capacity: the number of objects that fit into a packet; the
        others are due in the next CPM. dcc_ticks: the least interval that congestion control grants.
        """
        parameters = self._parameters
        sightings = self._record_sightings(tick, objects)
        least_ticks = min(max(dcc_ticks, parameters.min_ticks), parameters.max_ticks)
        if self._sent_tick is not None and tick - self._sent_tick < least_ticks:
            return None
        rows = self._select_rows(tick, objects, sightings)[:capacity]
        has_sensor = self._sensor_tick is None or tick - self._sensor_tick >= parameters.sensor_ticks
        if not len(rows) and not has_sensor:
            return None
        for row in rows.tolist():
            place = (objects.x[row], objects.y[row], objects.yaw[row], objects.speed[row])
            sightings[row].included = _Included(tick, *(float(value) for value in place))
        self._sent_tick = tick
        if has_sensor:
            self._sensor_tick = tick
        return DueCpm(rows, has_sensor)

    def find_confirmed(self, objects: Objects) -> Bool:
        """Return a mask (N,): detections that are no false positives, by what `check` has seen so far."""
        sightings = (self._sightings.get(name) for name in objects.ids)
        return np.array([one is not None and one.is_confirmed for one in sightings], dtype=np.bool_)

    def _record_sightings(self, tick: int, objects: Objects) -> list[_Sighting]:
        """Return the sighting of each detection, and forget those that are long past."""
        parameters = self._parameters
        for name, speed in zip(objects.ids, objects.speed.tolist(), strict=True):
            sighting = self._sightings.get(name)
            if sighting is None:
                is_confirmed = self._is_exact or tick < parameters.warm_ticks
                self._sightings[name] = _Sighting(tick, tick, is_confirmed)
                continue
            is_old = tick - sighting.first_tick >= parameters.confirmation_ticks
            is_moving = tick > sighting.first_tick and abs(speed) > parameters.moving_speed
            sighting.is_confirmed |= is_old or is_moving
            sighting.last_tick = tick
        self._sightings = {
            name: one for name, one in self._sightings.items() if tick - one.last_tick <= parameters.forget_ticks
        }
        return [self._sightings[name] for name in objects.ids]

    def _select_rows(self, tick: int, objects: Objects, sightings: list[_Sighting]) -> Int:
        """Return the rows (N,) of the objects that are due, the most useful first.

        The order is ours, the standard leaves it to the station: new objects, then pedestrians and cyclists, then
        others; of each the one with the greatest change relative to its threshold, then the nearest.
        """
        if not sightings:
            return np.zeros(0, dtype=np.int64)
        confirmed = np.array([one.is_confirmed for one in sightings], dtype=np.bool_)
        before = np.array([one.included or NEVER for one in sightings], dtype=np.float64).T
        changes = self._rate_changes(tick, objects, before)
        on_foot = _find_pedestrians(objects)
        is_group_due = (confirmed & on_foot & (tick - before[0] >= self._parameters.group_ticks)).any()
        is_due = confirmed & ((changes >= 1.0) | (on_foot & is_group_due))
        order = np.lexsort((-changes, ~on_foot, ~np.isinf(changes)))
        return order[is_due[order]]

    def _rate_changes(self, tick: int, objects: Objects, before: Float) -> Float:
        """Return the greatest change (N,) of objects since they were included, relative to what triggers; inf: new.

        before: (5, N) columns of `_Included`.
        """
        ticks, x, y, yaw, speed = before
        least = self._least_changes
        rates = [
            _exceed(portable.hypot(objects.x - x, objects.y - y), least.distance_m),
            _exceed(np.abs(objects.speed - speed), least.speed),
            (tick - ticks) / self._parameters.max_ticks,
        ]
        # What stands has no direction of motion.
        moves = np.minimum(np.abs(objects.speed), np.abs(speed)) > least.speed
        rates.append(_exceed(np.where(moves, np.abs(wrap_angles(objects.yaw - yaw)), 0.0), least.heading))
        return np.maximum.reduce(rates)


def _exceed(change: Float, threshold: float) -> Float:
    """Return changes (N,) relative to their threshold, below 1 unless they exceed it."""
    return np.where(change > threshold, change / threshold, np.minimum(change / threshold, BELOW_ONE))


def _compute_least_changes(profile: DetectionProfile, parameters: CpmGeneration) -> MotionThresholds:
    """Return the changes that count with that detector: those of the standard, or what its errors cannot explain."""
    thresholds = parameters.thresholds
    factor = parameters.sigmas * math.sqrt(2.0)  # of the difference of two measurements
    return MotionThresholds(
        max(thresholds.distance_m, factor * profile.spread),
        max(thresholds.speed, factor * profile.speed_sigma),
        max(thresholds.heading, factor * profile.yaw_sigma),
    )


def _find_pedestrians(objects: Objects) -> Bool:
    """Return a mask (N,): pedestrians and cyclists, the objects of type A."""
    return (objects.kind == Kind.PEDESTRIAN) | (objects.kind == Kind.CYCLIST)
