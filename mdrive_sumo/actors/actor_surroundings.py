"""The road users and objects of a frame, as scripted actors perceive them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Frame, Kind, RoadUsers
from mdrive_sumo.vehicle import dynamics

CAR_SIZE = (dynamics.MKZ_2017.length, dynamics.MKZ_2017.width)
"""Length and width [m]: every CAV is the paper's car (protocol K6)."""


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
        users = RoadUsers.from_egos(frame.egos, dict.fromkeys(frame.egos, CAR_SIZE)).concat(frame.actors)
        if frame.actors.ids is not self._ids or len(frame.egos) != self._cav_count:
            self._ids, self._cav_count = frame.actors.ids, len(frame.egos)
            self._constant_columns = self._build_constant_columns(users)
        return ActorSurroundings(
            users.x, users.y, users.yaw, users.speed, *self._constant_columns, cav_count=len(frame.egos)
        )

    def _build_constant_columns(self, users: RoadUsers) -> tuple[Float, Float, Bool, Int, Bool]:
        cavs, actor_ids = self._cav_count, users.ids[self._cav_count :]
        return (
            users.length / 2,
            users.width / 2,
            users.kind == Kind.PEDESTRIAN,
            np.array([-1] * cavs + [self._mover_index_by_id.get(name, -1) for name in actor_ids], dtype=np.int64),
            np.array([False] * cavs + [name in self._static_ids for name in actor_ids], dtype=np.bool_),
        )
