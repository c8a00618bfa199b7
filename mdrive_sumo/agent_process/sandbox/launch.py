"""Starts a program with reduced rights: the last steps between `fork` and `exec`.

Not `subprocess`: its child leaves no number free for the descriptors that box and bubblewrap find by number. Between
`fork` and `exec` there are system calls only, prepared before, so that locks of other threads do no harm.
"""

import ctypes
import os
import signal
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
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

MS_BIND, MS_REC, MS_PRIVATE, MS_NOSUID, MS_NODEV, MS_RDONLY, MS_REMOUNT = 4096, 16384, 1 << 18, 2, 4, 1, 32
CLONE_NEWNS = 0x00020000
PR_SET_PDEATHSIG = 1
FAILED = 126
LIBC: Any = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


class BoxError(WorldError):
    """The box failed, not what runs in it: the run is worthless and may be repeated."""


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
        report = _move_descriptors(launch.descriptors, report)
        step = "set limits and drop rights"
        _drop_privileges(launch, parent)
        step = "execute"
        os.execve(launch.argv[0], launch.argv, dict(launch.env))
    except OSError as error:
        os.write(report, f"{step}: {error}".encode())
    finally:
        os._exit(FAILED)


def _move_descriptors(descriptors: tuple[int, ...], report: int) -> int:
    """Numbers the descriptors from 0 and closes the rest; returns the new number of `report`."""
    moved = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 64) for fd in descriptors]
    report = fcntl.fcntl(report, fcntl.F_DUPFD_CLOEXEC, 64 + len(moved))
    for number, fd in enumerate(moved):
        os.dup2(fd, number, inheritable=True)
    os.closerange(len(moved), report)
    os.closerange(report + 1, 1 << 20)
    return report


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
        if not is_folder and outer.is_char_device():
            _mount("none", target, None, MS_BIND | MS_REMOUNT | MS_RDONLY)


def _mount(source: str, target: str, kind: str | None, flags: int) -> None:
    kind_bytes = None if kind is None else kind.encode()
    _check_result(LIBC.mount(os.fsencode(source), os.fsencode(target), kind_bytes, ctypes.c_ulong(flags), None))


def _check_result(result: int) -> None:
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
