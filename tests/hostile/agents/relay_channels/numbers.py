"""Channels of `relay` through numbers that the kernel counts for all of the host."""

import ctypes
import mmap
import os
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from relay_channels.base import FILE, PAGE, Channel, call


class Number(Channel):
    """A number that the kernel gives to what is made anew; making more of it moves the numbers that others get."""

    made = 1200
    """Objects for a bit that is set: more than other programs make meanwhile."""
    _before: int | None = None

    def make(self) -> int:
        """Make one, and return its number."""
        raise NotImplementedError

    def create(self) -> None:
        """Make one without a look at its number."""
        self.make()

    def arm(self) -> None:
        self._before = self.make()

    def send(self, bit: int) -> None:
        for _ in range(self.made * bit):
            self.create()

    def read(self) -> object:
        """The number itself, if it was not looked at before the bit."""
        found, before = self.make(), self._before
        return found if before is None else abs(found - before) > self.made // 2


class PipeInode(Number):
    def make(self) -> int:
        ends = os.pipe()
        try:
            return self.look(ends[0])
        finally:
            for fd in ends:
                os.close(fd)

    def create(self) -> None:
        for end in os.pipe():
            os.close(end)

    def look(self, fd: int) -> int:
        return os.fstat(fd).st_ino


class ByFstatat(PipeInode):
    def look(self, fd: int) -> int:
        found = (ctypes.c_uint64 * 18)()
        call(262, fd, b"", found, 0x1000)  # AT_EMPTY_PATH
        return int(found[1])


class ByFstatatWithHighBits(PipeInode):
    """The kernel ignores the upper half of both."""

    def look(self, fd: int) -> int:
        found = (ctypes.c_uint64 * 18)()
        call(262, fd | 1 << 40, b"", found, 0x1000 | 1 << 40)
        return int(found[1])


class ByStatx(PipeInode):
    def look(self, fd: int) -> int:
        found = (ctypes.c_uint64 * 32)()
        call(332, fd, b"", 0x1000, 0x100, found)  # AT_EMPTY_PATH, STATX_INO
        return int(found[4])


class ByLink(PipeInode):
    def look(self, fd: int) -> int:
        return int(str(Path(f"/proc/self/fd/{fd}").readlink())[len("pipe:[") : -1])


class ByPath(PipeInode):
    def look(self, fd: int) -> int:
        return Path(f"/dev/fd/{fd}").stat().st_ino


class ByDescriptorInfo(PipeInode):
    def look(self, fd: int) -> int:
        rows = dict(line.split(":\t", 1) for line in Path(f"/proc/self/fdinfo/{fd}").read_text().splitlines())
        return int(rows["ino"])


class ByRace(PipeInode):
    """A second thread exchanges a file for the pipe while the kernel, or who answers for it, looks."""

    def look(self, fd: int) -> int:
        place, ends = os.dup(FILE), threading.Event()

        def exchange() -> None:
            while not ends.is_set():
                os.dup2(fd, place)
                os.dup2(FILE, place)

        thread = threading.Thread(target=exchange)
        thread.start()
        try:
            known = {0, os.fstat(FILE).st_ino}
            return max((os.fstat(place).st_ino for _ in range(300)), key=lambda number: number not in known)
        finally:
            ends.set()
            thread.join()
            os.close(place)

    def read(self) -> object:
        """Only what is not the file's."""
        found = self.make()
        if found in (0, os.fstat(FILE).st_ino):
            return None
        return super().read()


class SocketInode(Number):
    def make(self) -> int:
        ends = socket.socketpair()
        try:
            return os.fstat(ends[0].fileno()).st_ino
        finally:
            for end in ends:
                end.close()


class MemoryFileInode(Number):
    def create(self) -> None:
        os.close(os.memfd_create("x"))

    def make(self) -> int:
        fd = os.memfd_create("x")
        try:
            return os.fstat(fd).st_ino
        finally:
            os.close(fd)


class SharedMemoryInode(Number):
    """Of a mapping that no file name leads to."""

    def make(self) -> int:
        with mmap.mmap(-1, PAGE) as mapped:
            address = ctypes.addressof(ctypes.c_char.from_buffer(mapped))
            rows = [row.split() for row in Path("/proc/self/maps").read_text().splitlines()]
        return next(int(row[4]) for row in rows if row[0].startswith(f"{address:x}-"))

    def create(self) -> None:
        mmap.mmap(-1, PAGE).close()


class ProcessInode(Number):
    """Of a folder of `/proc`."""

    def make(self) -> int:
        with open_process() as pid:
            return Path(f"/proc/{pid}/fd").stat().st_ino

    def create(self) -> None:
        for end in os.pipe():
            os.close(end)


class ProcessDescriptor(Number):
    made = 24

    def create(self) -> None:
        with open_process():
            pass

    def make(self) -> int:
        with open_process() as pid:
            fd = os.pidfd_open(pid)
            try:
                return os.fstat(fd).st_ino
            finally:
                os.close(fd)


class ProcessNumber(ProcessDescriptor):
    def make(self) -> int:
        with open_process() as pid:
            return pid


class SocketCookie(Number):
    def make(self) -> int:
        with socket.socket(socket.AF_UNIX) as one:
            return struct.unpack("Q", one.getsockopt(socket.SOL_SOCKET, 57, 8))[0]


class SharedMemoryKey(Number):
    """System V."""

    def make(self) -> int:
        found = call(29, 0, PAGE, 0o1600)  # shmget(IPC_PRIVATE, IPC_CREAT)
        call(31, found, 0, None)  # shmctl(IPC_RMID)
        return found


class FileInode(Number):
    """Of a new file in memory."""

    def make(self) -> int:
        fd = os.open("/dev/shm", os.O_TMPFILE | os.O_RDWR)
        try:
            return os.fstat(fd).st_ino
        finally:
            os.close(fd)


class FileInodeByPath(Number):
    def make(self) -> int:
        path = Path(f"/dev/shm/relay-{os.getpid()}")
        path.touch()
        try:
            return path.stat().st_ino
        finally:
            path.unlink()


@contextmanager
def open_process() -> Iterator[int]:
    """A process that waits until it was looked at."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(writing)
        os.read(reading, 1)
        os._exit(0)
    os.close(reading)
    try:
        yield pid
    finally:
        os.close(writing)
        os.waitpid(pid, 0)
