"""Answers `fstat` for the programs of boxes, with the identity of anonymous objects left out.

The kernel numbers pipes, sockets and memory files by counters of the whole host; `fstat` tells these numbers. A filter
(`stat_filter`) has the kernel ask this program instead of answering (`seccomp_unotify(2)`). It looks at the file of the
descriptor itself and writes its own result into the caller's memory, so that a second thread gains nothing by
exchanging descriptor or path meanwhile. Files on the box's own mounts are told as they are.

Run by `supervisor_process` as a program of its own that imports little: one for each evaluator, with a child for each
box, which has the box's user and control group. Its standard input is a socket; the evaluator sends one message a box.
Where a supervisor ends before its box, the kernel answers ENOSYS, and the evaluator misses the last word on the socket.
"""

import ctypes
import errno
import fcntl
import os
import select
import signal
import socket
import struct
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple, Never

RECEIVE, SEND, IS_VALID, SET_FLAGS = 0xC0502100, 0xC0182101, 0x40082102, 0x40082104
"""Requests of a listener. Source, as for the structures and flags below: Linux, `linux/seccomp.h`."""
NOTIFICATION, RESPONSE, IDENTITY = struct.Struct("=QII iIQ 6Q"), struct.Struct("=QqiI"), struct.Struct("=Q")
SYNCHRONOUS_WAKE_UP = 1
"""The asking thread sleeps until it is answered, so both may use one core in turns (Linux 6.6)."""

AT_FDCWD, AT_EMPTY_PATH = -100, 0x1000
KNOWN_FLAGS = 0x100 | 0x800 | AT_EMPTY_PATH
"""AT_SYMLINK_NOFOLLOW and AT_NO_AUTOMOUNT mean nothing for a descriptor."""
STATX = struct.Struct("=IIQ IIIHxx QQQQ qIi qIi qIi qIi IIII Q")
STATX_SIZE, STATX_MASK, STATX_MNT_ID = 256, 0x17FF, 0x1000
"""Size of the structure; basic fields and the number of the mount (Linux 5.8). Source: `linux/stat.h`."""
STAT = {"x86_64": struct.Struct("=QQQIII4xQqqq6Q24x"), "aarch64": struct.Struct("=QQIIIIQ8xqi4xq6Q8x")}
"""`struct stat` of the kernel. Source: `asm/stat.h` of each architecture."""
MACHINE = os.uname().machine
OVERFLOW_ID = 65534
"""How a user outside of the box is called inside."""
FSOPEN, FSCONFIG, FSCONFIG_CREATE = 430, 431, 6
"""Calls, with the same numbers on all architectures, and a command. Source: `linux/mount.h`."""
FEWEST_NUMBERS = 2
"""Words of a line of process numbers outside of boxes: its name and one number."""
LARGEST_MESSAGE, MOST_GROUPS = 64, 16
"""Bytes of a request, which is two numbers, and open files with it: a link, and at most four groups of version 1."""
MOST_DESCRIPTORS = 1 << 20
"""The kernel's default of how many a process may have (`fs.nr_open`)."""
LIBC = ctypes.CDLL(None, use_errno=True)
PR_SET_PDEATHSIG = 1
"""Source: `linux/prctl.h`."""
DONE = b"."
"""Told to the evaluator when no process of the box is left."""


class WaitingCall(NamedTuple):
    """The thread whose call waits for an answer."""

    thread: int
    is_fstat: bool
    arguments: tuple[int, ...]
    memory: int
    """Its memory, opened."""


@dataclass(slots=True)
class StatSupervisor:
    """Answers the calls of one box."""

    listener: int
    fstat_number: int
    held: list[int]
    """Descriptors to close when the box is set up."""
    mounts: set[int] = field(default_factory=set[int])
    """Numbers of mounts that the box sees."""
    are_mounts_final: bool = False
    """Whether they were read when the box was set up: nothing in it mounts anything later."""
    owner: int = field(default_factory=os.getuid)
    """The user of the box."""
    statx: ctypes.Array[ctypes.c_char] = field(default_factory=lambda: ctypes.create_string_buffer(STATX_SIZE))
    """Where the kernel writes each result, whole."""

    def serve(self) -> None:
        """Until no process of the box is left."""
        with suppress(OSError):  # an older kernel
            fcntl.ioctl(self.listener, SET_FLAGS, SYNCHRONOUS_WAKE_UP)
        poller = select.poll()
        poller.register(self.listener, select.POLLIN)
        while True:
            events = poller.poll()[0][1]
            if events & select.POLLIN:
                self._answer_one()
            elif events:
                return

    def _answer_one(self) -> None:
        request = bytearray(NOTIFICATION.size)
        try:
            fcntl.ioctl(self.listener, RECEIVE, request)
        except OSError as error:
            if error.errno in (errno.ENOENT, errno.EINTR):  # the caller has ended
                return
            raise
        identity, thread, _, number, _, _, *arguments = NOTIFICATION.unpack(request)
        try:
            memory = os.open(f"/proc/{thread}/mem", os.O_RDWR)
        except OSError as error:
            self._respond(identity, error.errno or errno.EIO)
            return
        if self.held:
            self._release_held(thread)
        try:
            caller = WaitingCall(thread, number == self.fstat_number, tuple(arguments), memory)
            problem = self._answer(caller, identity)
        finally:
            os.close(memory)
        self._respond(identity, problem)

    def _release_held(self, thread: int) -> None:
        with suppress(OSError):  # the caller has ended
            if is_program(thread):
                while self.held:
                    os.close(self.held.pop())

    def _answer(self, caller: WaitingCall, identity: int) -> int:
        """Write the result; return 0 or the number of an error."""
        try:
            target, place = find_target(caller)
            fields = read_statx(target, self.statx)
            result = self._make_result(fields, caller.thread)
            # The thread's number may be another's by now; its memory, opened before, is not.
            fcntl.ioctl(self.listener, IS_VALID, IDENTITY.pack(identity))
            os.pwrite(caller.memory, result, place)
        except OSError as error:
            return errno.EFAULT if error.errno == errno.EIO else error.errno or errno.EIO
        except OverflowError:
            return errno.EFAULT
        return 0

    def _make_result(self, fields: tuple[int, ...], thread: int) -> bytes:
        mask, mount = fields[0], fields[-1]
        is_known = bool(mask & STATX_MNT_ID) and self._is_mounted(mount, thread)
        return pack_stat(fields, is_known, self.owner)

    def _is_mounted(self, mount: int, thread: int) -> bool:
        """Whether it is a mount that the box sees; those of pipes, sockets and memory files are the kernel's own."""
        if mount not in self.mounts and not self.are_mounts_final:
            self.are_mounts_final = is_program(thread)
            self.mounts |= read_mounts(thread)
        return mount in self.mounts

    def _respond(self, identity: int, problem: int) -> None:
        try:
            fcntl.ioctl(self.listener, SEND, RESPONSE.pack(identity, 0, -problem, 0))
        except OSError as error:
            if error.errno != errno.ENOENT:  # the caller has ended
                raise


def find_target(caller: WaitingCall) -> tuple[str, int]:
    """Return the path of what is asked for, and the address for the result. Raises OSError with the caller's error."""
    descriptor, *rest = caller.arguments
    number = ctypes.c_int(descriptor & 0xFFFFFFFF).value
    if caller.is_fstat:
        place = rest[0]
    else:
        path, place, flags = rest[:3]
        if flags & 0xFFFFFFFF & ~KNOWN_FLAGS or (path and os.pread(caller.memory, 1, path) != b"\0"):
            # The kernel would follow the path, which the caller can change meanwhile.
            raise OSError(errno.EINVAL, "not a descriptor alone")
    if not caller.is_fstat and number == AT_FDCWD:
        return f"/proc/{caller.thread}/cwd", place
    if number < 0:
        raise OSError(errno.EBADF, "negative")
    return f"/proc/{caller.thread}/fd/{number}", place


def read_statx(path: str, into: ctypes.Array[ctypes.c_char]) -> tuple[int, ...]:
    """Return the fields of `struct statx`, written `into` a buffer. Raises OSError; EBADF if there is nothing."""
    if LIBC.statx(AT_FDCWD, path.encode(), 0, STATX_MASK, into) != 0:
        number = ctypes.get_errno()
        raise OSError(errno.EBADF if number == errno.ENOENT else number, "statx")
    return STATX.unpack_from(into)


def read_mounts(thread: int) -> set[int]:
    """Return the numbers of the mounts that a process sees."""
    with open(f"/proc/{thread}/mountinfo", "rb") as file:  # noqa: PTH123 (imports little)
        return {int(line.split(b" ", 1)[0]) for line in file}


def pack_stat(fields: tuple[int, ...], is_known: bool, owner: int) -> bytes:
    """Return `struct stat` of fields of `struct statx`; of an object that is not known, kind, size and owner only.

    owner: the user of the box, who alone has a number inside.
    """
    _, block, _, links, uid, gid, mode, inode, size, blocks, _, *times, node_major, node_minor, major, minor, _ = fields
    access, access_ns, _, _, _, _, change, change_ns, _, modification, modification_ns, _ = times
    shown = (access, access_ns, modification, modification_ns, change, change_ns) if is_known else (0,) * 6
    device, inode = (os.makedev(major, minor), inode) if is_known else (0, 0)
    uid, gid = (uid if uid == owner else OVERFLOW_ID), (gid if gid == owner else OVERFLOW_ID)
    node = os.makedev(node_major, node_minor)
    if MACHINE == "x86_64":
        return STAT["x86_64"].pack(device, inode, links, mode, uid, gid, node, size, block, blocks, *shown)
    return STAT["aarch64"].pack(device, inode, mode, links, uid, gid, node, size, block, blocks, *shown)


def take_device_numbers(count: int) -> list[int]:
    """Return descriptors that each hold a device number; none where this is not root.

    A file system in memory has the lowest number that is free, and `stat` of a path tells it: how many boxes live. With
    a random amount taken while a box is set up, its own numbers say little of that.
    """
    held: list[int] = []
    for _ in range(count):
        context = LIBC.syscall(ctypes.c_long(FSOPEN), b"tmpfs", ctypes.c_long(0))
        if context < 0:
            break
        held.append(context)
        LIBC.syscall(ctypes.c_long(FSCONFIG), *map(ctypes.c_long, (context, FSCONFIG_CREATE, 0, 0, 0)))
    return held


def is_program(thread: int) -> bool:
    """Whether a thread is one of a box that is set up: bubblewrap does that as process 1 of the box's own numbers."""
    with open(f"/proc/{thread}/status", "rb") as file:  # noqa: PTH123 (imports little)
        numbers = next((line for line in file if line.startswith(b"NSpid:")), b"").split()
    return len(numbers) > FEWEST_NUMBERS and int(numbers[-1]) > 1


def supervise(message: bytes, descriptors: list[int]) -> Never:
    """In the child for a box: with its user and control groups, until it ends."""
    uid, fstat_number = (int(word) for word in message.split())
    link, *groups = descriptors
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as file:  # noqa: PTH123 (imports little)
        file.write("-1000")  # where memory runs out, the box ends and not its supervisor; root only
    try:
        for entry in groups:
            os.write(entry, b"0")
            os.close(entry)
    except OSError:
        os._exit(0)  # the box is closed already; one that still lives is answered ENOSYS
    held = take_device_numbers(os.urandom(1)[0])
    if uid >= 0:
        os.setgroups([])
        os.setresgid(uid, uid, uid)
        os.setresuid(uid, uid, uid)
        LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)  # the change of user has cleared it
    with socket.socket(fileno=link) as channel:
        listener = socket.recv_fds(channel, 1, 1)[1]
        if listener:
            StatSupervisor(listener[0], fstat_number, held).serve()
        with suppress(OSError):  # the evaluator has closed the box meanwhile
            channel.send(DONE)
    os._exit(0)


def main() -> None:
    """Until the evaluator has ended."""
    os.closerange(3, MOST_DESCRIPTORS)  # what the evaluator's libraries leave open
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the kernel collects the children
    with socket.socket(fileno=0) as control:
        while True:
            message, descriptors, _, _ = socket.recv_fds(control, LARGEST_MESSAGE, MOST_GROUPS)
            if not message:
                return
            if os.fork() == 0:
                control.close()
                supervise(message, descriptors)
            for fd in descriptors:
                os.close(fd)


if __name__ == "__main__":
    main()
