"""Actors from several sources as one, sorted by id."""

import numpy as np

from mdrive_sumo.geometry import Int
from mdrive_sumo.state import Actors


class Together:
    """Merges two sets of actors; the order is worked out anew only when somebody comes or goes."""

    def __init__(self) -> None:
        self._of: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._ids: tuple[str, ...] = ()
        self._order: Int = np.zeros(0, dtype=np.int64)

    def __call__(self, first: Actors, second: Actors) -> Actors:
        """All of both; nobody is in both. `ids` is the same object as long as they are the same."""
        if not len(second) or not len(first):
            return first if len(first) else second
        if self._of[0] is not first.ids or self._of[1] is not second.ids:
            ids = first.ids + second.ids
            self._of, self._order = (first.ids, second.ids), np.argsort(np.array(ids), kind="stable")
            self._ids = tuple(ids[i] for i in self._order)
        columns = ("kind", "x", "y", "yaw", "speed", "length", "width")
        pairs = (np.concatenate((getattr(first, name), getattr(second, name))) for name in columns)
        return Actors(self._ids, *(column[self._order] for column in pairs))
