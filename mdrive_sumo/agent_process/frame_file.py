"""The frame file: large arrays of an observation reach the agent through memory that it can only read.

The trusted side writes and never reads it; the socket carries the offsets. Two files alternate, so that a late reader
gets the previous frame and never half of the next one. The files are memory-mapped, which is ten times faster than
writing and reading (400 kB: 4 against 40 microseconds).
"""

import mmap
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agent_process.frame_reader import NAMES, view_bytes
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import import_posix

if TYPE_CHECKING:
    import fcntl
else:
    fcntl = import_posix("fcntl")

PREFIX = "mdrive-frames-"
ALIGNMENT = 64
"""Of each array [bytes]: a line of the cache of x86-64 and of most ARM processors."""
LEAST_BYTES = 2**16
"""Smallest size of a file that holds an array [bytes]."""
MAX_FRAME_BYTES = 2**27
"""Of all arrays of an observation [bytes]: the largest rig of the paper has 54 MB. Each agent has two files."""
MEMORY = Path("/dev/shm")
"""Where the folder of an agent is created; a box sees only its own."""


class FrameFolder:
    """The folder `path` of one agent: written here, mounted read-only for the agent."""

    def __init__(self, place: Path | None = None) -> None:
        """place: the parent folder; None: in memory if possible. Raises OSError."""
        place = place or (MEMORY if os.access(MEMORY, os.W_OK) else Path(tempfile.gettempdir()))
        _remove_abandoned_folders(place)
        self.path = Path(tempfile.mkdtemp(prefix=".new-", dir=place))
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._files = [os.open(self.path / name, flags, 0o644) for name in NAMES]
        fcntl.flock(
            self._files[0], fcntl.LOCK_EX | fcntl.LOCK_NB
        )  # held while its owner lives, see `_remove_abandoned_folders`
        if os.getuid() == 0:
            self.path.chmod(0o755)  # a boxed agent has a user id of its own
        self.path = self.path.rename(place / (PREFIX + self.path.name.removeprefix(".new-")))  # locked: may be swept
        self._maps: list[npt.NDArray[np.uint8]] = [np.zeros(0, np.uint8) for _ in NAMES]
        self._turn, self._end = 0, 0

    def begin(self) -> None:
        """Begin a new frame, which overwrites the one before the last."""
        self._turn, self._end = 1 - self._turn, 0

    def store(self, array: npt.NDArray[Any]) -> int:
        """Write a contiguous array and return its place for `FrameReader.load`.

        Raises InputError for a frame that is too large, and OSError if there is no room.
        """
        offset, end = self._end, self._end + array.nbytes
        if end > len(self._maps[self._turn]):
            self._grow(end)
        self._maps[self._turn][offset:end] = view_bytes(array)
        self._end = -(-end // ALIGNMENT) * ALIGNMENT
        return offset * len(NAMES) + self._turn

    def _grow(self, size: int) -> None:
        """Allocate space before it is mapped: a full disk is an error then, and no SIGBUS later."""
        if size > MAX_FRAME_BYTES:
            raise InputError(
                f"sensors: expected arrays of at most {MAX_FRAME_BYTES} bytes in an observation, found {size} or more;"
                " smaller images (build_camera_rig with a scale below 1) or fewer cameras"
            )
        size = max(LEAST_BYTES, 1 << (size - 1).bit_length())
        try:
            os.posix_fallocate(self._files[self._turn], 0, size)
        except OSError as error:
            sentence = f"expected room for {size} bytes of sensor data in {self.path.parent}; fewer workers need less"
            raise OSError(error.errno, f"{error.strerror}: {sentence}") from None
        self._maps[self._turn] = np.frombuffer(mmap.mmap(self._files[self._turn], size), np.uint8)

    def close(self) -> None:
        """Remove the folder; never raises."""
        shutil.rmtree(self.path, ignore_errors=True)
        for file in self._files:
            os.close(file)
        self._files, self._maps = [], []


def _remove_abandoned_folders(place: Path) -> None:
    """Remove the folders of killed processes: the lock of their first file is free."""
    for folder in place.glob(f"{PREFIX}*"):
        with suppress(OSError):  # of another user, in use, just being created, or removed meanwhile
            file = os.open(folder / NAMES[0], os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(file)
