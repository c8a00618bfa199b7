"""What scripted road users see around them: everybody else in a frame, as rows of arrays."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Frame, Kind
from mdrive_sumo.vehicle import dynamics

CAR = dynamics.MKZ_2017
"""Every CAV is the paper's car (protocol K6)."""


@dataclass(frozen=True, slots=True)
class Around:
    """CAVs first, then the actors of the frame: (O,) each."""

    x: Float
    y: Float
    yaw: Float
    speed: Float
    half_length: Float
    half_width: Float
    on_foot: Bool
    mover: Int
    """Which mover of the cast it is; -1: none of them."""
    still: Bool
    """Whether it is a scripted one that stands all the time."""
    cavs: int
    """How many of the rows are CAVs."""


class Onlooker:
    """Makes `Around` of frames; remembers who is who while nobody comes or goes."""

    def __init__(self, movers: Mapping[str, int], still: frozenset[str]) -> None:
        """`movers`: row by id; `still`: ids of the scripted ones that only stand."""
        self._movers, self._still = movers, still
        self._ids: tuple[str, ...] | None = None
        self._cavs = -1
        self._roles: tuple[Float, Float, Bool, Int, Bool]

    def around(self, frame: Frame) -> Around:
        """Everybody in the frame."""
        actors, egos = frame.actors, frame.egos.values()
        if actors.ids is not self._ids or len(egos) != self._cavs:
            self._ids, self._cavs = actors.ids, len(egos)
            self._roles = self._assigned(frame)
        own = np.array([(ego.x, ego.y, ego.yaw, ego.speed) for ego in egos], dtype=np.float64).reshape(-1, 4).T
        x, y, yaw, speed = (
            np.concatenate(pair) for pair in zip(own, (actors.x, actors.y, actors.yaw, actors.speed), strict=True)
        )
        return Around(x, y, yaw, speed, *self._roles, cavs=len(egos))

    def _assigned(self, frame: Frame) -> tuple[Float, Float, Bool, Int, Bool]:
        actors, cavs = frame.actors, len(frame.egos)
        return (
            np.concatenate((np.full(cavs, CAR.length), actors.length)) / 2,
            np.concatenate((np.full(cavs, CAR.width), actors.width)) / 2,
            np.concatenate((np.zeros(cavs, dtype=np.bool_), actors.kind == Kind.PEDESTRIAN)),
            np.array([-1] * cavs + [self._movers.get(name, -1) for name in actors.ids], dtype=np.int64),
            np.array([False] * cavs + [name in self._still for name in actors.ids], dtype=np.bool_),
        )
