"""FrameReader: the agent's side of the frame file, see `frame_file`. A module of its own: every box imports it."""

import mmap
import os
from typing import Any

import numpy as np
import numpy.typing as npt

NAMES = ("0", "1")
"""The two files of a folder."""


class FrameReader:
    """Reads frames in the agent's process."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Raises OSError."""
        self._files = [os.open(os.path.join(path, name), os.O_RDONLY | os.O_CLOEXEC) for name in NAMES]  # noqa: PTH118
        self._maps: list[npt.NDArray[np.uint8]] = [np.zeros(0, np.uint8) for _ in NAMES]

    def load(self, array: npt.NDArray[Any], place: int) -> None:
        """Fill an array with the stored values: a copy, which an agent may keep. Raises OSError."""
        offset, turn = divmod(place, len(NAMES))
        end = offset + array.nbytes
        if end > len(self._maps[turn]):
            self._map(turn, end)
        view_bytes(array)[:] = self._maps[turn][offset:end]

    def _map(self, turn: int, end: int) -> None:
        size = os.fstat(self._files[turn]).st_size
        if size < end:
            raise OSError(f"expected a frame of at least {end} bytes, found {size}")
        self._maps[turn] = np.frombuffer(mmap.mmap(self._files[turn], size, prot=mmap.PROT_READ), np.uint8)


def view_bytes(array: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Return the bytes of a contiguous array, not a copy."""
    return array.reshape(-1).view(np.uint8)
