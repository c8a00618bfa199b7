"""Channels of `relay` through files, memory and devices that two boxes may have in common."""

import ctypes
import fcntl
import mmap
import os
import struct
import threading
import time
from contextlib import suppress
from pathlib import Path

from relay_channels.base import FILE, LIBC, PAGE, PATH, Channel, address_of, call


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
    _before = 0
    """What other programs of the machine hold."""

    def arm(self) -> None:
        self._before = self._count()

    def send(self, bit: int) -> None:
        self._context = ctypes.c_ulong(0)
        if bit:
            call(206, 1000, ctypes.byref(self._context))

    def read(self) -> object:
        return self._count() - self._before >= 1000

    def _count(self) -> int:
        return int(Path("/proc/sys/fs/aio-nr").read_text())

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
