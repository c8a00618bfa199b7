"""Tracks objects that stand: for how long, and where exactly.

Detections are noisy. An object stands while it is detected near the mean of its positions, whatever its measured speed,
and the mean is more accurate than a single detection.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

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


class StandingObjects(NamedTuple):
    """Objects, and how long each has been standing."""

    objects: Objects
    duration_s: Float
    """(N,)"""
    never_moved: Bool
    """(N,) whether it has not moved since its first detection."""


class StaticObjectTracker:
    """Accumulates the detections of standing objects by id."""

    def __init__(self, parameters: TrackerParameters = TRACKER) -> None:
        self._parameters = parameters
        self._standstills = np.zeros(0, STANDSTILL)
        self._row_by_id: dict[str, int] = {}
        """Id of each object -> its row; in the order of rows."""

    def update(self, tick: int, objects: Objects, recall_s: float) -> StandingObjects:
        """Add the detections of a tick; return them and the undetected static objects that stood for `recall_s` [s].

        Undetected vehicles are not added: they may have driven off.
        """
        self._standstills, rows, missed = add_detections(
            self._standstills, self._row_by_id, tick, objects, recall_s, self._parameters
        )
        if len(missed):
            ids, kinds = tuple(self._row_by_id), np.full(len(missed), Kind.STATIC, dtype=np.uint8)
            means = _build_mean_columns(self._standstills[missed])
            objects = objects.concat(Objects(tuple(ids[row] for row in missed), kinds, *means.values()))
            rows = np.concatenate((rows, missed))
        standstills = self._standstills[rows]
        return StandingObjects(objects, _compute_durations(standstills), standstills["has_moved"] == 0)

    def replace_by_means(self, objects: Objects, mask: Bool) -> Objects:
        """Return the objects with those of `mask` (N,) as static objects at their mean position and size."""
        if not mask.any():
            return objects
        rows = np.flatnonzero(mask)
        means = _build_mean_columns(self._standstills[[self._row_by_id[objects.ids[row]] for row in rows.tolist()]])
        columns = {name: _replace_rows(getattr(objects, name), rows, values) for name, values in means.items()}
        kind = objects.kind.copy()
        kind[rows] = Kind.STATIC
        return replace(objects, kind=kind, **columns)


@twin
def add_detections(
    standstills: Rows, row_by_id: dict[str, int], tick: int, objects: Objects, recall_s: float,
    parameters: TrackerParameters, /,
) -> tuple[Rows, Int, Int]:  # fmt: skip
    """Return the standstills with the detections of a tick, the row of each object, and the rows of missed ones.

    New objects follow, and are added to `row_by_id`. Static objects that stood for `recall_s` [s] are missed.
    """
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
    missed_ticks = tick - after["last_tick"]
    is_missed = (after["kind"] == Kind.STATIC) & (_compute_durations(after) >= recall_s)
    is_missed &= (missed_ticks > 0) & (missed_ticks <= parameters.recall_ticks)
    return after, np.array(places, dtype=np.int64), np.flatnonzero(is_missed)


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
