"""Starts a program with reduced rights: the last steps between `fork` and `exec`.

Not `subprocess`: its child leaves no number free for the descriptors that box and bubblewrap find by number. Between
`fork` and `exec` there are system calls only, prepared before, so that locks of other threads do no harm.
"""

import ctypes
import os
import signal
import socket
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Never

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.posix import import_posix

if TYPE_CHECKING:
    import fcntl
    import resource
else:
    fcntl = import_posix("fcntl")
    resource = import_posix("resource")

STAGE = Path("/run/mdrive-sumo")
"""Mount point, in the launched process's own view, of a folder with everything that the box will see."""

MS_BIND, MS_REC, MS_PRIVATE, MS_REMOUNT = 4096, 16384, 1 << 18, 32
MS_RDONLY, MS_NOSUID, MS_NODEV, MS_NOEXEC = 1, 2, 4, 8
CLONE_NEWNS = 0x00020000
PR_SET_PDEATHSIG, PR_SET_NO_NEW_PRIVS = 1, 38
"""Sources of these and of the next ones: `linux/mount.h`, `linux/sched.h`, `linux/prctl.h`, `linux/seccomp.h`."""
SECCOMP_SET_MODE_FILTER, NEW_LISTENER, WAIT_KILLABLE = 1, 8, 32
"""The last: a signal does not end a call that the supervisor has taken (Linux 5.19)."""
FAILED = 126
"""Exit code of a launch that could not execute its program, as that of a shell."""
LIBC: Any = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


class BoxError(WorldError):
    """The box failed, not what runs in it: the run is worthless and may be repeated."""


class FilterProgram(ctypes.Structure):
    """`struct sock_fprog`."""

    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


@dataclass(frozen=True, slots=True)
class StatWatch:
    """A filter that asks a supervisor about calls, and where the supervisor waits for the filter's listener."""

    program: FilterProgram
    seccomp_number: int
    """Of the system call that installs it."""
    link: socket.socket


@dataclass(frozen=True, slots=True)
class LaunchPlan:
    """A program, and what is arranged before it begins."""

    argv: tuple[str, ...]
    env: Mapping[str, str]
    descriptors: tuple[int, ...]
    """Become 0, 1, 2, ... of the program; all others are closed."""
    rlimits: tuple[tuple[int, int, int], ...]
    """Which, soft and hard."""
    join: tuple[int, ...] = ()
    """Open `cgroup.procs` files."""
    uid: int | None = None
    """User and group to become; None stays."""
    staged: tuple[tuple[Path, str], ...] = ()
    """Paths bound below `STAGE` while still root: a uid without rights cannot reach what lies in a closed folder."""
    nice: int = 5
    cwd: str = "/"
    watch: StatWatch | None = None
    """Who answers `fstat`; None: the kernel."""


def make_program(instructions: bytes) -> FilterProgram:
    """Return the filter for the kernel; an instruction has 8 bytes."""
    return FilterProgram(len(instructions) // 8, instructions)


def start(launch: LaunchPlan) -> int:
    """Process id of the running program. Raises BoxError if it could not be started."""
    if launch.staged:
        _make_stage()
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of any fork beside threads
        pid = os.fork()
    if pid == 0:
        _exec(launch, writing)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        problem = pipe.read().decode(errors="replace")
    if problem:
        os.waitpid(pid, 0)
        raise BoxError(f"sandbox: {launch.argv[0]} could not be started: {problem}")
    return pid


def _make_stage() -> None:
    try:
        STAGE.mkdir(mode=0o755, parents=True, exist_ok=True)
    except OSError as error:
        raise BoxError(f"sandbox: the mount point {STAGE} cannot be made: {error}") from error


def _exec(launch: LaunchPlan, report: int) -> Never:
    """In the child: ends in `exec`, or tells the parent why not."""
    parent = os.getppid()
    step = "leave the session"
    try:
        os.setsid()
        step = "join the control groups"
        for fd in launch.join:
            os.write(fd, b"0")
        step = "bind what the box sees"
        _mount_staged(launch.staged)
        step = "take the descriptors"
        link = () if launch.watch is None else (launch.watch.link.fileno(),)
        report, *link = _move_descriptors(launch.descriptors, (report, *link))
        step = "set limits and drop rights"
        _drop_privileges(launch, parent)
        step = "have fstat supervised"
        _install_watch(launch.watch, link)
        step = "execute"
        os.execve(launch.argv[0], launch.argv, dict(launch.env))
    except OSError as error:
        os.write(report, f"{step}: {error}".encode())
    finally:
        os._exit(FAILED)


def _move_descriptors(descriptors: tuple[int, ...], own: tuple[int, ...]) -> list[int]:
    """Numbers the descriptors from 0 and closes the rest; returns the new numbers of `own`, which `exec` closes."""
    moved = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 64) for fd in (*descriptors, *own)]
    kept = moved[len(descriptors) :]
    first = max(moved) + 1
    kept = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, first) for fd in kept]
    for number, fd in enumerate(moved[: len(descriptors)]):
        os.dup2(fd, number, inheritable=True)
    os.closerange(len(descriptors), kept[0])
    for low, high in pairwise((*kept, 1 << 20)):
        os.closerange(low + 1, high)
    return kept


def _install_watch(watch: StatWatch | None, link: list[int]) -> None:
    """From here on each `fstat` of this process, and of all that it begins, waits for the supervisor."""
    if watch is None:
        return
    _check_result(LIBC.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
    listener = -1
    for flags in (NEW_LISTENER | WAIT_KILLABLE, NEW_LISTENER):
        words = map(ctypes.c_long, (watch.seccomp_number, SECCOMP_SET_MODE_FILTER, flags))
        listener = LIBC.syscall(*words, ctypes.byref(watch.program))
        if listener >= 0:
            break
    _check_result(min(listener, 0))
    with socket.socket(fileno=link[0]) as channel:
        socket.send_fds(channel, [b"1"], [listener])
    os.close(listener)


def _drop_privileges(launch: LaunchPlan, parent: int) -> None:
    for which, soft, hard in launch.rlimits:
        resource.setrlimit(which, (soft, hard))
    os.nice(launch.nice)
    os.chdir(launch.cwd)
    if launch.uid is not None:
        os.setgroups([])
        os.setresgid(launch.uid, launch.uid, launch.uid)
        os.setresuid(launch.uid, launch.uid, launch.uid)
    _check_result(LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0))  # after the uid, whose change clears it
    if os.getppid() != parent:
        raise OSError("the evaluator ended meanwhile")
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)  # Python ignores them, and programs inherit that
    signal.pthread_sigmask(signal.SIG_SETMASK, [])


def _mount_staged(staged: tuple[tuple[Path, str], ...]) -> None:
    """Binds the paths where only this process sees them."""
    if not staged:
        return
    _check_result(LIBC.unshare(CLONE_NEWNS))
    _mount("none", "/", None, MS_REC | MS_PRIVATE)
    _mount("tmpfs", str(STAGE), "tmpfs", MS_NOSUID | MS_NODEV)
    os.chmod(STAGE, 0o755)  # noqa: PTH101 (no more Python than needed between fork and exec)
    for outer, name in staged:
        target = f"{STAGE}/{name}"
        is_folder = outer.is_dir()
        if is_folder:
            os.mkdir(target)  # noqa: PTH102
        else:
            os.close(os.open(target, os.O_CREAT | os.O_WRONLY))
        _mount(str(outer), target, None, MS_BIND | MS_REC)
        # Read-only here already: gVisor's file server opens the files at this place, and reading them would change
        # their times of access, which a later box in the slot sees.
        kept = os.statvfs(outer).f_flag & (MS_NOSUID | MS_NODEV | MS_NOEXEC)
        _mount("none", target, None, MS_BIND | MS_REMOUNT | MS_RDONLY | kept)


def _mount(source: str, target: str, kind: str | None, flags: int) -> None:
    kind_bytes = None if kind is None else kind.encode()
    _check_result(LIBC.mount(os.fsencode(source), os.fsencode(target), kind_bytes, ctypes.c_ulong(flags), None))


def _check_result(result: int) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
