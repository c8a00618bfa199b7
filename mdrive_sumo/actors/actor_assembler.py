"""Merge moving and static scripted actors into one `Actors`."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.actors.path_tables import PathPoints
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Actors
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor


class ActorAssembler:
    """Merges moving and static scripted actors; caches the constant columns until the set of present actors changes."""

    def __init__(self, actors: Sequence[Actor], movers: Sequence[int]) -> None:
        """`actors`: all scripted actors, sorted by id; `movers`: indices of those that move."""
        self._rows = np.array(movers, dtype=np.int64)
        starts = [(actor.start.x, actor.start.y, actor.start.yaw, 0.0) for actor in actors]
        self._all = np.array(starts, dtype=np.float64).reshape(-1, 4).T
        self._ids = tuple(actor.id for actor in actors)
        self._kind = np.array([KIND_BY_NAME[actor.kind] for actor in actors], dtype=np.uint8)
        self._size = np.array([(actor.length, actor.width) for actor in actors], dtype=np.float64).reshape(-1, 2).T
        self._present: Bool | None = None
        self._constant: Actors

    def assemble(self, points: PathPoints, speed: Float, present: Bool) -> Actors:
        """Return the static actors and the present movers; `points`, `speed` and `present` are (M,) over the movers."""
        moving = self._all.copy()
        moving[:, self._rows] = points.x, points.y, points.yaw, speed
        if self._present is None or not np.array_equal(self._present, present):
            self._select_present(present)
        constant = self._constant
        if len(constant.ids) < len(self._ids):
            moving = moving[:, self._is_shown]
        x, y, yaw, v = moving
        return Actors(constant.ids, constant.kind, x, y, yaw, v, constant.length, constant.width)

    def _select_present(self, present: Bool) -> None:
        self._present = present.copy()
        self._is_shown = np.ones(len(self._ids), dtype=np.bool_)
        self._is_shown[self._rows] = present
        ids = tuple(name for name, shown in zip(self._ids, self._is_shown.tolist(), strict=True) if shown)
        length, width = self._size[:, self._is_shown]
        zeros = np.zeros(len(ids))
        self._constant = Actors(ids, self._kind[self._is_shown], zeros, zeros, zeros, zeros, length, width)
