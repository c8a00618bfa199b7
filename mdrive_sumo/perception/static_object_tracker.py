"""Tracks objects that stand: for how long, and where exactly.

Detections are noisy. An object stands while it is detected near the mean of its positions, whatever its measured speed,
and the mean is more accurate than a single detection.
"""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind


@dataclass(frozen=True, slots=True)
class TrackerParameters:
    """Parameters of `StaticObjectTracker`."""

    max_offset_m: float = 1.0
    """A detection further from the mean starts a new standstill: three standard errors; 0.2 m/s for 10 s is further."""
    lost_ticks: int = 2 * TICKS_PER_SECOND
    """An object that was not detected for this long starts a new standstill."""
    recall_ticks: int = TICKS_PER_SECOND
    """A static object is assumed to remain for this long undetected: detectors miss objects for half a second."""


TRACKER = TrackerParameters()

_Row: TypeAlias = tuple[float, float, float, float, float, float]


@dataclass(slots=True)
class _Standstill:
    """Detections of one standing object: first and last tick, their number and their sum."""

    kind: int
    first_tick: int
    last_tick: int
    count: int = 0
    total: _Row = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def duration_s(self) -> float:
        """Time between the first and the last detection [s]."""
        return (self.last_tick - self.first_tick) * DT

    def compute_distance(self, x: float, y: float) -> float:
        """Return the distance [m] of a point from the mean position."""
        return portable.distance((self.total[0] / self.count, self.total[1] / self.count), (x, y))

    def compute_mean(self) -> _Row:
        """Return the mean x, y, cosine and sine of yaw, length, width."""
        x, y, cos, sin, length, width = self.total
        count = self.count
        return x / count, y / count, cos / count, sin / count, length / count, width / count

    def add(self, tick: int, detection: _Row) -> None:
        """Add a detection: x, y, cosine and sine of yaw, length, width."""
        x, y, cos, sin, length, width = self.total
        more_x, more_y, more_cos, more_sin, more_length, more_width = detection
        self.total = x + more_x, y + more_y, cos + more_cos, sin + more_sin, length + more_length, width + more_width
        self.last_tick, self.count = tick, self.count + 1


class StaticObjectTracker:
    """Accumulates the detections of standing objects by id."""

    def __init__(self, parameters: TrackerParameters = TRACKER) -> None:
        self._parameters = parameters
        self._standstill_by_id: dict[str, _Standstill] = {}
        self._moved_ids: set[str] = set()

    def update(self, tick: int, objects: Objects) -> None:
        """Add the detections of a tick."""
        yaw = objects.yaw
        table = (objects.x, objects.y, *portable.cos_sin(yaw), objects.length, objects.width)
        rows = zip(*(column.tolist() for column in table), strict=True)
        for name, kind, row in zip(objects.ids, objects.kind.tolist(), rows, strict=True):
            standstill = self._standstill_by_id.get(name)
            has_left = (
                standstill is not None and standstill.compute_distance(row[0], row[1]) > self._parameters.max_offset_m
            )
            if has_left:
                self._moved_ids.add(name)
            if standstill is None or has_left or tick - standstill.last_tick > self._parameters.lost_ticks:
                standstill = self._standstill_by_id[name] = _Standstill(kind, tick, tick)
            standstill.add(tick, row)

    def compute_standstill_durations(self, objects: Objects) -> Float:
        """Return for how long (N,) [s] each object has been standing; `update` must have been called with them."""
        return np.array([self._standstill_by_id[name].duration_s for name in objects.ids])

    def find_never_moved(self, objects: Objects) -> Bool:
        """Return a mask (N,): objects that have not moved since their first detection."""
        return np.array([name not in self._moved_ids for name in objects.ids], dtype=np.bool_)

    def add_missed_objects(self, tick: int, objects: Objects, min_s: float) -> Objects:
        """Return the objects and the undetected static ones that stood for at least `min_s` [s].

        Undetected vehicles are not added: they may have driven off.
        """
        missed = {
            name: one
            for name, one in self._standstill_by_id.items()
            if one.kind == Kind.STATIC
            and one.duration_s >= min_s
            and 0 < tick - one.last_tick <= self._parameters.recall_ticks
        }
        if not missed:
            return objects
        kinds = np.full(len(missed), Kind.STATIC, dtype=np.uint8)
        return objects.concat(Objects(tuple(missed), kinds, *_build_mean_columns(list(missed.values())).values()))

    def replace_by_means(self, objects: Objects, mask: Bool) -> Objects:
        """Return the objects with those of `mask` (N,) as static objects at their mean position and size."""
        if not mask.any():
            return objects
        rows = np.flatnonzero(mask)
        means = _build_mean_columns([self._standstill_by_id[objects.ids[row]] for row in rows])
        columns = {name: _replace_rows(getattr(objects, name), rows, values) for name, values in means.items()}
        kind = objects.kind.copy()
        kind[rows] = Kind.STATIC
        return replace(objects, kind=kind, **columns)


def _build_mean_columns(standstills: list[_Standstill]) -> dict[str, Float]:
    """Return the columns (K,) of `Objects` from x to width for objects at their mean."""
    x, y, cos, sin, length, width = np.array([one.compute_mean() for one in standstills]).T
    return {"x": x, "y": y, "yaw": portable.atan2(sin, cos), "speed": 0.0 * x, "length": length, "width": width}


def _replace_rows(column: Float, rows: Int, values: Float) -> Float:
    """Return a copy of the column with other values in some rows."""
    changed = column.copy()
    changed[rows] = values
    return changed
