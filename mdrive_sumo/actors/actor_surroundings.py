"""The road users and objects of a frame, as scripted actors perceive them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Frame, Kind
from mdrive_sumo.vehicle import dynamics

CAR = dynamics.MKZ_2017
"""Every CAV is the paper's car (protocol K6)."""


@dataclass(frozen=True, slots=True)
class ActorSurroundings:
    """All O road users and objects of a frame: CAVs first, then actors. Arrays are (O,)."""

    x: Float
    y: Float
    yaw: Float
    speed: Float
    half_length: Float
    half_width: Float
    is_pedestrian: Bool
    mover_index: Int
    """Index among the moving scripted actors; -1 for everything else."""
    is_static: Bool
    """Whether it is a scripted actor that never moves."""
    cav_count: int
    """Number of CAVs, which are the first rows."""


class SurroundingsBuilder:
    """Builds `ActorSurroundings`; caches the constant columns until the set of actors changes."""

    def __init__(self, mover_index_by_id: Mapping[str, int], static_ids: frozenset[str]) -> None:
        """`mover_index_by_id`: the moving scripted actors; `static_ids`: those that never move."""
        self._mover_index_by_id, self._static_ids = mover_index_by_id, static_ids
        self._ids: tuple[str, ...] | None = None
        self._cav_count = -1
        self._constant_columns: tuple[Float, Float, Bool, Int, Bool]

    def build(self, frame: Frame) -> ActorSurroundings:
        """Return the CAVs and actors of a frame."""
        actors, egos = frame.actors, frame.egos.values()
        if actors.ids is not self._ids or len(egos) != self._cav_count:
            self._ids, self._cav_count = actors.ids, len(egos)
            self._constant_columns = self._build_constant_columns(frame)
        own = np.array([(ego.x, ego.y, ego.yaw, ego.speed) for ego in egos], dtype=np.float64).reshape(-1, 4).T
        x, y, yaw, speed = (
            np.concatenate(pair) for pair in zip(own, (actors.x, actors.y, actors.yaw, actors.speed), strict=True)
        )
        return ActorSurroundings(x, y, yaw, speed, *self._constant_columns, cav_count=len(egos))

    def _build_constant_columns(self, frame: Frame) -> tuple[Float, Float, Bool, Int, Bool]:
        actors, cavs = frame.actors, len(frame.egos)
        return (
            np.concatenate((np.full(cavs, CAR.length), actors.length)) / 2,
            np.concatenate((np.full(cavs, CAR.width), actors.width)) / 2,
            np.concatenate((np.zeros(cavs, dtype=np.bool_), actors.kind == Kind.PEDESTRIAN)),
            np.array([-1] * cavs + [self._mover_index_by_id.get(name, -1) for name in actors.ids], dtype=np.int64),
            np.array([False] * cavs + [name in self._static_ids for name in actors.ids], dtype=np.bool_),
        )
