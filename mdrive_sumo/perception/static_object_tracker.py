"""Tracks objects that stand: for how long, and where exactly.

Detections are noisy. An object stands while it is detected near the mean of its positions, whatever its measured speed,
and the mean is more accurate than a single detection.
"""

from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind
from mdrive_sumo.perception.measurements import Rows


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

STANDSTILL = np.dtype(
    [
        ("kind", "i8"),  # value of `Kind`
        ("has_moved", "i8"),  # 1: it was elsewhere before
        ("first_tick", "i8"),  # of the detections of this standstill
        ("last_tick", "i8"),
        ("count", "i8"),  # their number,
        ("x", "f8"),  # and their sums
        ("y", "f8"),
        ("cos", "f8"),  # of the yaw
        ("sin", "f8"),
        ("length", "f8"),
        ("width", "f8"),
    ]
)


class StaticObjectTracker:
    """Accumulates the detections of standing objects by id."""

    def __init__(self, parameters: TrackerParameters = TRACKER) -> None:
        self._parameters = parameters
        self._standstills = np.zeros(0, STANDSTILL)
        self._row_by_id: dict[str, int] = {}
        """Id of each object -> its row; in the order of rows."""

    def update(self, tick: int, objects: Objects) -> None:
        """Add the detections of a tick."""
        self._standstills = add_detections(self._standstills, self._row_by_id, tick, objects, self._parameters)

    def _get_standstills(self, objects: Objects) -> Rows:
        return self._standstills[[self._row_by_id[name] for name in objects.ids]]

    def compute_standstill_durations(self, objects: Objects) -> Float:
        """Return for how long (N,) [s] each object has been standing; `update` must have been called with them."""
        return _compute_durations(self._get_standstills(objects))

    def find_never_moved(self, objects: Objects) -> Bool:
        """Return a mask (N,): objects that have not moved since their first detection."""
        return self._get_standstills(objects)["has_moved"] == 0

    def add_missed_objects(self, tick: int, objects: Objects, min_s: float) -> Objects:
        """Return the objects and the undetected static ones that stood for at least `min_s` [s].

        Undetected vehicles are not added: they may have driven off.
        """
        standstills, missed_ticks = self._standstills, tick - self._standstills["last_tick"]
        is_missed = (missed_ticks > 0) & (missed_ticks <= self._parameters.recall_ticks)
        is_missed &= (standstills["kind"] == Kind.STATIC) & (_compute_durations(standstills) >= min_s)
        rows = np.flatnonzero(is_missed).tolist()
        if not rows:
            return objects
        ids = tuple(self._row_by_id)
        kinds = np.full(len(rows), Kind.STATIC, dtype=np.uint8)
        means = _build_mean_columns(standstills[rows])
        return objects.concat(Objects(tuple(ids[row] for row in rows), kinds, *means.values()))

    def replace_by_means(self, objects: Objects, mask: Bool) -> Objects:
        """Return the objects with those of `mask` (N,) as static objects at their mean position and size."""
        if not mask.any():
            return objects
        rows = np.flatnonzero(mask)
        means = _build_mean_columns(self._get_standstills(objects)[rows])
        columns = {name: _replace_rows(getattr(objects, name), rows, values) for name, values in means.items()}
        kind = objects.kind.copy()
        kind[rows] = Kind.STATIC
        return replace(objects, kind=kind, **columns)


@twin
def add_detections(
    standstills: Rows, row_by_id: dict[str, int], tick: int, objects: Objects, parameters: TrackerParameters, /
) -> Rows:
    """Return the standstills with the detections of a tick. New objects follow, and are added to `row_by_id`."""
    cos, sin = portable.cos_sin(objects.yaw)
    boxes = zip(objects.x, objects.y, cos, sin, objects.length, objects.width, strict=True)
    places = [row_by_id.setdefault(name, len(row_by_id)) for name in objects.ids]
    after = np.zeros(len(row_by_id), STANDSTILL)
    after[: len(standstills)] = standstills
    for place, kind, box in zip(places, objects.kind.tolist(), boxes, strict=True):
        row = after[place]
        count = int(row["count"])
        if count and portable.hypot(row["x"] / count - box[0], row["y"] / count - box[1]) > parameters.max_offset_m:
            row["has_moved"], count = 1, 0
        if not count or tick - row["last_tick"] > parameters.lost_ticks:
            after[place] = (kind, row["has_moved"], tick, tick, 0, *(0.0,) * len(box))
        for name, value in zip(("x", "y", "cos", "sin", "length", "width"), box, strict=True):
            row[name] += value
        row["last_tick"], row["count"] = tick, row["count"] + 1
    return after


def _compute_durations(standstills: Rows) -> Float:
    """Return the times (N,) [s] between the first and the last detections."""
    return (standstills["last_tick"] - standstills["first_tick"]) * DT


def _build_mean_columns(standstills: Rows) -> dict[str, Float]:
    """Return the columns (K,) of `Objects` from x to width for objects at their mean."""
    columns = ("x", "y", "cos", "sin", "length", "width")
    x, y, cos, sin, length, width = (standstills[name] / standstills["count"] for name in columns)
    return {"x": x, "y": y, "yaw": portable.atan2(sin, cos), "speed": 0.0 * x, "length": length, "width": width}


def _replace_rows(column: Float, rows: Int, values: Float) -> Float:
    """Return a copy of the column with other values in some rows."""
    changed = column.copy()
    changed[rows] = values
    return changed
