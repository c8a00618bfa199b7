"""Who stands, for how long and where exactly: what a driver remembers of things that do not move.

Detections are noisy, so a thing stands while it stays near the mean of where it was seen, whatever its speed is said
to be, and the mean says better where it is than any single look.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind

STAYS_M = 1.0
"""How far from its mean place something may be seen: three standard errors; 0.2 m/s for 10 s brings one further."""
LOST_TICKS = 2 * TICKS_PER_SECOND
"""What has not been seen for so long begins anew."""
RECALL_TICKS = TICKS_PER_SECOND
"""Detectors miss things for half a second at a time: what stood is believed to stand on for so long unseen."""


@dataclass(slots=True)
class _Stay:
    """Looks at one thing that stands: since when, the last one, how many, and the sum of what was seen."""

    kind: int
    since: int
    last: int
    count: int = 0
    total: Float = field(default_factory=lambda: np.zeros(6))

    @property
    def seconds(self) -> float:
        """For how long it has been seen to stand."""
        return (self.last - self.since) * DT

    def mean(self) -> Float:
        """(6,) x, y, cosine and sine of yaw, length, width."""
        return self.total / self.count

    def add(self, tick: int, look: Float) -> None:
        self.last, self.count, self.total = tick, self.count + 1, self.total + look


class StaticObjectTracker:
    """Kept from look to look."""

    def __init__(self) -> None:
        self._stays: dict[str, _Stay] = {}
        self._moved: set[str] = set()

    def update(self, tick: int, objects: Objects) -> None:
        """Takes notice of what is seen now."""
        yaw = objects.yaw
        table = (objects.x, objects.y, np.cos(yaw), np.sin(yaw), objects.length, objects.width)
        for name, kind, look in zip(objects.ids, objects.kind.tolist(), np.column_stack(table), strict=True):
            stay = self._stays.get(name)
            gone = stay is not None and math.dist(stay.mean()[:2], look[:2]) > STAYS_M
            if gone:
                self._moved.add(name)
            if stay is None or gone or tick - stay.last > LOST_TICKS:
                stay = self._stays[name] = _Stay(kind, tick, tick)
            stay.add(tick, look)

    def compute_standstill_durations(self, objects: Objects) -> Float:
        """(N,) [s] for how long each object has been seen standing; it must have been looked at."""
        return np.array([self._stays[name].seconds for name in objects.ids])

    def find_never_moved(self, objects: Objects) -> Bool:
        """(N,) who has not moved since it was first seen."""
        return np.array([name not in self._moved for name in objects.ids], dtype=np.bool_)

    def add_missed_objects(self, tick: int, objects: Objects, least_s: float) -> Objects:
        """The objects, and after them the static ones that stood for so long [s] and are missed just now.

        A car that is missed may have driven off.
        """
        missed = {
            name: stay
            for name, stay in self._stays.items()
            if stay.kind == Kind.STATIC and stay.seconds >= least_s and 0 < tick - stay.last <= RECALL_TICKS
        }
        if not missed:
            return objects
        x, y, cos, sin, length, width = np.array([stay.mean() for stay in missed.values()]).T
        kinds = np.full(len(missed), Kind.STATIC, dtype=np.uint8)
        return objects.concat(Objects(tuple(missed), kinds, x, y, np.arctan2(sin, cos), 0.0 * x, length, width))

    def replace_by_means(self, objects: Objects, which: Bool) -> Objects:
        """The objects; those of `which` (N,) as static ones, where and how they stand on average."""
        if not which.any():
            return objects
        rows = np.flatnonzero(which)
        x, y, cos, sin, length, width = np.array([self._stays[objects.ids[row]].mean() for row in rows]).T
        better = {"x": x, "y": y, "yaw": np.arctan2(sin, cos), "speed": 0.0 * x, "length": length, "width": width}
        columns = {name: _with(getattr(objects, name), rows, values) for name, values in better.items()}
        kind = objects.kind.copy()
        kind[rows] = Kind.STATIC
        return replace(objects, kind=kind, **columns)


def _with(column: Float, rows: Int, values: Float) -> Float:
    changed = column.copy()
    changed[rows] = values
    return changed
