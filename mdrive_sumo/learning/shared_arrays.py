"""SharedArrays: arrays that worker processes fill, and that this process reads without a copy."""

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True)
class ArrayPlace:
    """Where another process finds an array."""

    path: str
    dtype: str
    shape: tuple[int, ...]

    def open(self) -> npt.NDArray[Any]:
        """Return the array. Raises OSError after it was closed."""
        return np.memmap(self.path, self.dtype, "r+", shape=self.shape)


class SharedArrays:
    """A context manager; workers may open the arrays within it, this process keeps them as long as it likes.

    The memory is freed with the last reference to an array. Linux has files in memory without a name, which no limit of
    a mounted file system touches (containers have 64 MB of /dev/shm); elsewhere they are temporary files.
    """

    def __init__(self, rows: Mapping[str, npt.NDArray[Any]], count: int) -> None:
        """rows: one row of each array; count: how many it gets."""
        self.arrays: Arrays = {}
        self.places: dict[str, ArrayPlace] = {}
        self._files: list[int] = []
        self._paths: list[str] = []
        for name, row in rows.items():
            path = self._make_file(max(row.nbytes * count, 1))
            place = self.places[name] = ArrayPlace(path, row.dtype.str, (count, *row.shape))
            self.arrays[name] = np.asarray(place.open())

    def _make_file(self, size: int) -> str:
        if hasattr(os, "memfd_create"):
            number = os.memfd_create("mdrive-sumo-samples")
            path = f"/proc/{os.getpid()}/fd/{number}"
        else:
            number, path = tempfile.mkstemp(prefix="mdrive-sumo-samples-")
            self._paths.append(path)
        self._files.append(number)
        os.ftruncate(number, size)
        return path

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for number in self._files:
            os.close(number)
        for path in self._paths:
            Path(path).unlink()
