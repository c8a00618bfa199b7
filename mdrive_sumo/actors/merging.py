"""Actors from two sources (SUMO's and those on logs; both and the scripted ones) as one, in the order of their ids."""

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Actors


class Crowd:
    """Merges two casts tick by tick. The order is made anew only when somebody comes or goes."""

    def __init__(self) -> None:
        self._of: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._whole: Actors | None = None
        self._order: Int = np.zeros(0, dtype=np.int64)

    def merged(self, first: Actors, second: Actors) -> Actors:
        """All of both; ids of the two are different. The same `ids` object as long as nobody comes or goes."""
        if not len(second):
            return first
        if not len(first):
            return second
        if self._whole is None or self._of[0] is not first.ids or self._of[1] is not second.ids:
            self._arrange(first, second)
        whole = self._whole
        assert whole is not None
        x, y, yaw, speed = self._moving(first, second)
        return Actors(whole.ids, whole.kind, x, y, yaw, speed, whole.length, whole.width)

    def _moving(self, first: Actors, second: Actors) -> Float:
        """(4, N) x, y, yaw, speed in the order of ids."""
        both = np.empty((4, len(first) + len(second)))
        for row, name in zip(both, ("x", "y", "yaw", "speed"), strict=True):
            row[: len(first)], row[len(first) :] = getattr(first, name), getattr(second, name)
        return both[:, self._order]

    def _arrange(self, first: Actors, second: Actors) -> None:
        ids = first.ids + second.ids
        order = sorted(range(len(ids)), key=ids.__getitem__)
        self._of, self._order = (first.ids, second.ids), np.array(order, dtype=np.int64)
        kind = np.concatenate((first.kind, second.kind))[self._order]
        length = np.concatenate((first.length, second.length))[self._order]
        width = np.concatenate((first.width, second.width))[self._order]
        nil = np.zeros(len(ids))
        found = tuple(ids[i] for i in order)
        if self._whole is not None and self._whole.ids == found:
            found = self._whole.ids
        self._whole = Actors(found, kind, nil, nil, nil, nil, length, width)
