"""Reads and writes what is not its own. `argv`: files of the host that must not be found."""

import fcntl
import os
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from tell import opened, tell


def reads(path: str) -> bool:
    with Path(path).open("rb") as file:
        return bool(file.read(64))


def lists(path: str) -> bool:
    return any(True for _ in Path(path).iterdir())


def writes(path: str) -> bool:
    with Path(path).open("ab") as file:
        return file.write(b"1") == 1


def writes_at(path: str) -> bool:
    """Opening is enough: an address that one may write to is easily found."""
    with Path(path).open("r+b"):
        return True


secret = ("/etc/shadow", "/etc/passwd", "/etc/hostname", "/proc/kcore", "/proc/kmsg", "/proc/1/mem", "/dev/mem")
devices = ("/dev/vda", "/dev/sda", "/dev/kvm", "/dev/fuse", "/dev/net/tun", "/dev/kmsg")
folders = ("/root", "/home", "/work", "/var/log", "/sys/kernel", "/run", "/mnt", "/oldroot", "/newroot")
closed = (
    "/x",
    "/usr/x",
    "/usr/bin/python3",
    "/agent/x",
    "/agent/tell.py",
    "/dev/x",
    "/opt/x",
    "/etc/x",
    "/kit/x",
    "/site/x",
    "/frames/x",
    "/run/x",
)
kernel = ("/proc/sys/kernel/hostname", "/proc/sysrq-trigger", "/proc/sys/kernel/core_pattern")
attempts: dict[str, Callable[[], object]] = {}
attempts |= {f"read {path}": partial(reads, path) for path in (*secret, *devices, *sys.argv[1:])}
attempts |= {f"list {path}": partial(lists, path) for path in folders}
attempts |= {f"write {path}": partial(writes, path) for path in (*closed, *kernel)}
attempts["climb out"] = partial(reads, "/proc/1/root/../../etc/shadow")
attempts["less likely to be killed"] = lambda: Path("/proc/self/oom_score_adj").write_text("-500")
attempts["change mode"] = lambda: Path("/agent").chmod(0o777) is None
attempts["write to the box's first process"] = partial(writes_at, "/proc/1/mem")


def told_by(name: str) -> str:
    with suppress(OSError):
        return Path(name).read_bytes().decode()
    return ""


def is_open(fd: int) -> bool:
    try:
        fcntl.fcntl(fd, fcntl.F_GETFD)
    except OSError:
        return False
    return True


def describe(fd: int) -> str:
    kinds = {stat.S_IFCHR: "device", stat.S_IFIFO: "pipe", stat.S_IFSOCK: "socket"}
    return kinds.get(stat.S_IFMT(os.fstat(fd).st_mode), "other")


host_paths = [word for word in told_by("/proc/1/cmdline").split("\0") if "/tmp/" in word and word not in sys.argv]
OWN = (
    "mountinfo",
    "maps",
    "smaps",
    "status",
    "stat",
    "fdinfo/3",
    "autogroup",
    "sessionid",
    "cgroup",
    "net/unix",
    "timers",
)
own = {name: partial(reads, f"/proc/self/{name}") for name in OWN}
own |= {f"list {name}": partial(lists, f"/proc/self/{name}") for name in ("fd", "ns", "map_files", "task")}
tell(
    open=opened(attempts),
    told_of_itself=opened(own),
    told_by_command_line=host_paths,
    told_by_environment=told_by("/proc/1/environ"),
    kinds={fd: describe(fd) for fd in range(200) if is_open(fd)},
    identities=sorted({(os.fstat(fd).st_dev, os.fstat(fd).st_ino) for fd in range(200) if is_open(fd)}),
)
