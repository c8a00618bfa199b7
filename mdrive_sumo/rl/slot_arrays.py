"""SlotArrays: actions and results of all CAVs of one environment, in memory that processes may share."""

from enum import IntEnum
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt


class SlotStatus(IntEnum):
    """What has become of the learner of a slot in the latest step."""

    RESTING = 0
    """No CAV, or one that ended before."""
    ACTIVE = 1
    TERMINATED = 2
    """The CAV ended by the protocol in this step."""
    TRUNCATED = 3
    """The episode was given up in this step."""


class SlotShape(NamedTuple):
    """The sizes of the arrays."""

    slots: int
    """Learners."""
    observation: int
    """Numbers in an observation."""
    control: int
    """Numbers in the part of an action that drives."""
    message: int
    """Bytes in the part that talks."""
    grid: tuple[int, ...] = (0,)
    """Layers, rows and columns of the grid in an observation; without any cell: there is none."""


class SlotArrays(NamedTuple):
    """One row per slot in each array. The owner writes actions, the simulation all else."""

    observations: npt.NDArray[np.float32]
    """(slots, observation)"""
    controls: npt.NDArray[np.float32]
    """(slots, control), of slots that `asked` marks."""
    rewards: npt.NDArray[np.float32]
    """(slots,)"""
    messages: npt.NDArray[np.uint8]
    """(slots, message)"""
    asked: npt.NDArray[np.uint8]
    """(slots,) 1 where the owner gives an action; other CAVs repeat their last control."""
    status: npt.NDArray[np.uint8]
    """(slots,) values of `SlotStatus`."""
    grids: npt.NDArray[np.uint8]
    """(slots, layers, rows, columns), the second part of an observation."""

    @classmethod
    def lay_out(cls, shape: SlotShape, memory: Any = None) -> Self:
        """Return the arrays over a buffer of `count_bytes`; None: over memory of their own."""
        memory = bytearray(count_bytes(shape)) if memory is None else memory
        arrays: list[npt.NDArray[Any]] = []
        offset = 0
        for rows, kind in _list_arrays(shape):
            arrays.append(np.ndarray(rows, kind, memory, offset))
            offset += arrays[-1].nbytes
        return cls(*arrays)


def count_bytes(shape: SlotShape) -> int:
    """Return the size of the buffer that holds the arrays."""
    return sum(int(np.prod(rows)) * np.dtype(kind).itemsize for rows, kind in _list_arrays(shape))


def _list_arrays(shape: SlotShape) -> list[tuple[tuple[int, ...], type]]:
    """Return shape and type of each array: those with wider numbers first, so that all are aligned."""
    slots = shape.slots
    return [
        ((slots, shape.observation), np.float32),
        ((slots, shape.control), np.float32),
        ((slots,), np.float32),
        ((slots, shape.message), np.uint8),
        ((slots,), np.uint8),
        ((slots,), np.uint8),
        ((slots, *shape.grid), np.uint8),
    ]
