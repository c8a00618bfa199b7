"""The stage: all scripted road users as `Actors`, those that only stand and those that move."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.actors.path_tables import Places
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Actors
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor


class Stage:
    """Puts the poses of movers among the props. Remembers who is there while nobody comes or goes."""

    def __init__(self, actors: Sequence[Actor], movers: Sequence[int]) -> None:
        """`actors` sorted by id; `movers`: which of them move."""
        self._rows = np.array(movers, dtype=np.int64)
        starts = [(actor.start.x, actor.start.y, actor.start.yaw, 0.0) for actor in actors]
        self._all = np.array(starts, dtype=np.float64).reshape(-1, 4).T
        self._ids = tuple(actor.id for actor in actors)
        self._kind = np.array([KIND_BY_NAME[actor.kind] for actor in actors], dtype=np.uint8)
        self._size = np.array([(actor.length, actor.width) for actor in actors], dtype=np.float64).reshape(-1, 2).T
        self._there: Bool | None = None
        self._cast: Actors

    def actors(self, places: Places, speed: Float, present: Bool) -> Actors:
        """Who is there: movers (M,) at their places if present, and every prop."""
        moving = self._all.copy()
        moving[:, self._rows] = places.x, places.y, places.yaw, speed
        if self._there is None or not np.array_equal(self._there, present):
            self._arrange(present)
        cast = self._cast
        if len(cast.ids) < len(self._ids):
            moving = moving[:, self._shown]
        x, y, yaw, v = moving
        return Actors(cast.ids, cast.kind, x, y, yaw, v, cast.length, cast.width)

    def _arrange(self, present: Bool) -> None:
        self._there = present.copy()
        self._shown = np.ones(len(self._ids), dtype=np.bool_)
        self._shown[self._rows] = present
        ids = tuple(name for name, shown in zip(self._ids, self._shown.tolist(), strict=True) if shown)
        length, width = self._size[:, self._shown]
        nil = np.zeros(len(ids))
        self._cast = Actors(ids, self._kind[self._shown], nil, nil, nil, nil, length, width)
