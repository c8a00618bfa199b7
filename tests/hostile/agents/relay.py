"""Sends and receives one bit at a time through whatever two boxes may have in common; numbers of x86-64.

Its evaluator says what to do, a line each: `arm`, `send 0`, `send 1`, `read` or `rest`, with the name of a channel. The
answer to `read` is what the receiver sees, null if it may not look; of a number it is the number, if nothing was armed.
argv: a file that all boxes are shown.
"""

import ctypes
import fcntl
import json
import mmap
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PAGE = 4096
LIBC = ctypes.CDLL(None, use_errno=True)
PATH = sys.argv[1]
FILE = os.open(PATH, os.O_RDONLY)
LIBC.mmap.restype = ctypes.c_void_p
START = LIBC.mmap(None, ctypes.c_size_t(1 << 20), mmap.PROT_READ, mmap.MAP_SHARED, FILE, ctypes.c_long(0))
"""Address of the file in memory: its pages are those of all programs that map it."""


def call(number: int, *words: object) -> int:
    """Raises OSError."""
    found = LIBC.syscall(ctypes.c_long(number), *(ctypes.c_long(w) if isinstance(w, int) else w for w in words))
    if found < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return int(found)


def address_of(page: int) -> int:
    return int(START) + page * PAGE


class Channel:
    """What one does and the other sees. The methods of a channel without a meaning do nothing."""

    def arm(self) -> None:
        """The receiver, before a bit."""

    def send(self, bit: int) -> None:
        """The sender."""

    def read(self) -> object:
        """The receiver, after it."""

    def rest(self) -> None:
        """The sender, when the bit was read."""


class RecordLock(Channel):
    """`F_GETLK` tells the range that another process has locked: 62 bits of it are data."""

    set_command, get_command = fcntl.F_SETLK, fcntl.F_GETLK

    def send(self, bit: int) -> None:
        kind = fcntl.F_RDLCK if bit else fcntl.F_UNLCK
        fcntl.fcntl(FILE, self.set_command, struct.pack("hhqqi4x", kind, 0, 12345, 10, 0))

    def read(self) -> object:
        found = fcntl.fcntl(FILE, self.get_command, struct.pack("hhqqi4x", fcntl.F_WRLCK, 0, 0, 0, 0))
        kind, _, start, length, _ = struct.unpack("hhqqi4x", found)
        return [kind, start, length]

    def rest(self) -> None:
        self.send(0)


class OpenFileLock(RecordLock):
    set_command, get_command = 37, 36


class Flock(Channel):
    path = PATH

    def send(self, bit: int) -> None:
        self._held = os.open(self.path, os.O_RDONLY)
        fcntl.flock(self._held, fcntl.LOCK_SH if bit else fcntl.LOCK_UN)

    def read(self) -> object:
        other = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return "held"
        finally:
            os.close(other)
        return "free"

    def rest(self) -> None:
        os.close(self._held)


class DeviceLock(Flock):
    """The device files are the host's."""

    path = "/dev/null"


class Inotify(Channel):
    def arm(self) -> None:
        self._queue = call(294, 0o4000)  # inotify_init1(IN_NONBLOCK)
        call(254, self._queue, PATH.encode(), 0x20)  # IN_OPEN

    def send(self, bit: int) -> None:
        if bit:
            os.close(os.open(PATH, os.O_RDONLY))

    def read(self) -> object:
        try:
            return len(os.read(self._queue, 4096))
        except BlockingIOError:
            return 0
        finally:
            os.close(self._queue)


class AioCount(Channel):
    def send(self, bit: int) -> None:
        self._context = ctypes.c_ulong(0)
        if bit:
            call(206, 1000, ctypes.byref(self._context))

    def read(self) -> object:
        return int(Path("/proc/sys/fs/aio-nr").read_text()) >= 1000

    def rest(self) -> None:
        if self._context.value:
            call(207, ctypes.c_ulong(self._context.value))


class Residency(Channel):
    """A page of the file is in memory if the sender has read it, not if it had the kernel drop it."""

    def send(self, bit: int) -> None:
        if bit:
            os.pread(FILE, 1 << 20, 0)
        else:
            os.posix_fadvise(FILE, 0, 0, os.POSIX_FADV_DONTNEED)


class ByMincore(Residency):
    def read(self) -> object:
        seen = ctypes.create_string_buffer(4)
        call(27, address_of(8), 4 * PAGE, seen)
        return [byte & 1 for byte in seen.raw]


class ByCachestat(Residency):
    def read(self) -> object:
        found = (ctypes.c_uint64 * 5)()
        call(451, FILE, (ctypes.c_uint64 * 2)(0, 16 * PAGE), found, 0)
        return found[0]


class ByNowait(Residency):
    def read(self) -> object:
        try:
            return os.preadv(FILE, [bytearray(PAGE)], 16 * PAGE, 8)  # RWF_NOWAIT
        except BlockingIOError:
            return "absent"


class ByTime(Residency):
    def read(self) -> object:
        began = time.perf_counter()
        for page in range(0, 256, 2):
            os.pread(FILE, 1, page * PAGE)
        return "slow" if time.perf_counter() - began > 1e-3 else "quick"


class ByReadahead(ByTime):
    """Brings the pages in by `readahead`."""

    def send(self, bit: int) -> None:
        os.posix_fadvise(FILE, 0, 0, os.POSIX_FADV_DONTNEED)
        if bit:
            call(187, FILE, 0, 1 << 20)
            time.sleep(0.05)


class Futex(Channel):
    """Processes that map the same file wait on its pages for each other."""

    def send(self, bit: int) -> None:
        if bit:
            word = ctypes.c_uint32.from_address(address_of(3)).value
            limit = (ctypes.c_long * 2)(5, 0)
            threading.Thread(target=LIBC.syscall, args=(202, ctypes.c_void_p(address_of(3)), 0, word, limit)).start()
            time.sleep(0.05)

    def read(self) -> object:
        return call(202, ctypes.c_void_p(address_of(3)), 1, 100)  # FUTEX_WAKE: how many waited

    def rest(self) -> None:
        LIBC.syscall(202, ctypes.c_void_p(address_of(3)), 1, 100)


class SharedPages(Channel):
    """`smaps` tells whether another process maps the same page."""

    def send(self, bit: int) -> None:
        self._map = mmap.mmap(FILE, PAGE, prot=mmap.PROT_READ, offset=200 * PAGE) if bit else None
        if self._map is not None:
            assert self._map[0] is not None

    def read(self) -> object:
        mine = mmap.mmap(FILE, PAGE, prot=mmap.PROT_READ, offset=200 * PAGE)
        assert mine[0] is not None
        rows = Path("/proc/self/smaps").read_text().split(f"{200 * PAGE:08x} ")[1].splitlines()
        mine.close()
        return next(line for line in rows if line.startswith("Shared_Clean"))

    def rest(self) -> None:
        if self._map is not None:
            self._map.close()


class DeviceTimes(Channel):
    def arm(self) -> None:
        self._before = Path("/dev/tty").stat().st_mtime_ns

    def send(self, bit: int) -> None:
        if bit:
            time.sleep(0.02)  # a tick of the kernel's clock
            os.utime("/dev/tty")

    def read(self) -> object:
        return Path("/dev/tty").stat().st_mtime_ns != self._before


class HostMemory(Channel):
    """Free memory of the host; a step of 48 MiB."""

    def arm(self) -> None:
        self._before = self._free()

    def _free(self) -> int:
        words = (ctypes.c_ulong * 14)()
        with suppress(OSError):
            return int(Path("/proc/meminfo").read_text().split()[4]) * 1024
        call(99, words)
        return words[5]

    def send(self, bit: int) -> None:
        self._held = mmap.mmap(-1, 48 << 20) if bit else None
        if self._held is not None:
            for start in range(0, len(self._held), PAGE):
                self._held[start] = 1

    def read(self) -> object:
        return self._before - self._free() > 24 << 20

    def rest(self) -> None:
        if self._held is not None:
            self._held.close()


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


CHANNELS: dict[str, Channel] = {
    "record lock": RecordLock(),
    "open file lock": OpenFileLock(),
    "flock": Flock(),
    "lock of a device": DeviceLock(),
    "inotify": Inotify(),
    "aio-nr": AioCount(),
    "residency by mincore": ByMincore(),
    "residency by cachestat": ByCachestat(),
    "residency by RWF_NOWAIT": ByNowait(),
    "residency by time": ByTime(),
    "residency by readahead": ByReadahead(),
    "futex": Futex(),
    "shared pages": SharedPages(),
    "times of a device": DeviceTimes(),
    "memory of the host": HostMemory(),
    "inode of a pipe": PipeInode(),
    "inode of a pipe by fstatat": ByFstatat(),
    "inode of a pipe by fstatat with high bits": ByFstatatWithHighBits(),
    "inode of a pipe by statx": ByStatx(),
    "inode of a pipe by a link of /proc": ByLink(),
    "inode of a pipe by a path of /dev": ByPath(),
    "inode of a pipe by fdinfo": ByDescriptorInfo(),
    "inode of a pipe by a race": ByRace(),
    "inode of a socket": SocketInode(),
    "inode of a memory file": MemoryFileInode(),
    "inode of shared memory": SharedMemoryInode(),
    "inode in /proc": ProcessInode(),
    "inode of a process descriptor": ProcessDescriptor(),
    "number of a process": ProcessNumber(),
    "cookie of a socket": SocketCookie(),
    "key of shared memory": SharedMemoryKey(),
    "inode of a file in memory": FileInode(),
    "inode of a file in memory by path": FileInodeByPath(),
}


with suppress(OSError):  # the kernel counts some numbers for each processor
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def obey(words: list[str]) -> object:
    channel = CHANNELS[" ".join(words[1:]) if words[0] != "send" else " ".join(words[2:])]
    with suppress(OSError, LookupError, AttributeError, ValueError, StopIteration):
        return channel.send(int(words[1])) if words[0] == "send" else getattr(channel, words[0])()
    return None


with socket.socket(fileno=3) as evaluator, evaluator.makefile("rw") as lines:
    for line in lines:
        lines.write(json.dumps(obey(line.split())) + "\n")
        lines.flush()
