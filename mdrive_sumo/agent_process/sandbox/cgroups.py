"""Control groups: ceilings for all processes of a box together, or of an evaluator. Version 2 if delegated, else 1.

A box's group lies *inside* the group of its evaluator, so whatever limits the evaluator limits its boxes too.
"""

import os
import signal
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.agent_process.sandbox.limits import BoxLimits

NEEDED, WANTED = ("memory", "pids"), ("cpu", "cpuacct")
"""Controllers without which no group is made, and those that are used where they are."""
EPISODE_PREFIX = "mdrive-episode-"
"""Of the groups of evaluators' processes (`join_episode_group`). Boxes are made beside them, not inside."""
PERIOD_US = 100_000
"""Of the share of the processor: the kernel's default."""
PAUSE_S = 0.005
"""Between two looks whether the last process of a group is gone [s]; most need one or two."""
CHARGE_BYTES = 1 << 20
"""How far below its limit a group may be when the kernel refuses it more memory."""


@dataclass(frozen=True, slots=True)
class CgroupHierarchy:
    """Where groups of boxes are made."""

    version: int
    folders: Mapping[str, Path]
    """Controller and the evaluator's group in its hierarchy. Version 2 has one folder for all."""

    def describe(self) -> str:
        """As `doctor` says it."""
        return f"version {self.version}: {', '.join(self.folders)}"


def find_hierarchy(proc: Path = Path("/proc/self")) -> CgroupHierarchy | None:
    """The hierarchy in which this process may make groups with memory and pids controllers; None if there is none."""
    own = _parse_own_groups((proc / "cgroup").read_text())
    mounts = _parse_mounts((proc / "mountinfo").read_text())
    return _find_version_2(own, mounts) or _find_version_1(own, mounts)


def _parse_own_groups(text: str) -> dict[str, str]:
    """Controller ("" = version 2) to this process's group, from `/proc/self/cgroup`."""
    rows = (line.split(":", 2) for line in text.splitlines())
    return {
        controller: _leave_episode_group(group)
        for _, controllers, group in rows
        for controller in controllers.split(",")
    }


def _leave_episode_group(group: str) -> str:
    """The group around that of an episode, or the group itself: an episode's ceiling must not hold for its boxes."""
    above, _, name = group.rpartition("/")
    return (above or "/") if name.startswith(EPISODE_PREFIX) else group


def _parse_mounts(text: str) -> list[tuple[frozenset[str], str, Path]]:
    """Options ("cgroup2" for version 2), root within the hierarchy and mount point, from `/proc/self/mountinfo`."""
    mounts: list[tuple[frozenset[str], str, Path]] = []
    for line in text.splitlines():
        left, _, right = line.partition(" - ")
        root, point = left.split()[3:5]
        kind, _, options = right.split(" ", 2)
        if kind in ("cgroup", "cgroup2"):
            mounts.append((frozenset((kind, *options.split(","))), root, Path(point)))
    return mounts


def _locate_group_folder(group: str, root: str, point: Path) -> Path | None:
    """A group's folder under a mount that may show only part of its hierarchy, as in a container."""
    if root != "/" and (group == root or group.startswith(root + "/")):
        group = group[len(root) :]
    folder = point / group.lstrip("/")
    return folder if folder.is_dir() and os.access(folder, os.W_OK | os.X_OK) else None


def _find_version_2(own: Mapping[str, str], mounts: list[tuple[frozenset[str], str, Path]]) -> CgroupHierarchy | None:
    """The own group or, if its processes sit in a leaf, the one above: whichever hands its controllers down.

    A group of version 2 cannot hold both processes and controlled groups, hence the leaf (systemd: DelegateSubgroup=).
    """
    for options, root, point in mounts:
        leaf = _locate_group_folder(own.get("", ""), root, point) if "cgroup2" in options else None
        for folder in (leaf, leaf.parent) if leaf is not None and leaf != point else ():
            handed_down = _read_words(folder / "cgroup.subtree_control")
            if os.access(folder, os.W_OK) and set(NEEDED) <= set(handed_down):
                return CgroupHierarchy(2, {name: folder for name in (*NEEDED, *WANTED) if name in handed_down})
    return None


def _find_version_1(own: Mapping[str, str], mounts: list[tuple[frozenset[str], str, Path]]) -> CgroupHierarchy | None:
    folders: dict[str, Path] = {}
    for name in (*NEEDED, *WANTED):
        for options, root, point in mounts:
            folder = (
                _locate_group_folder(own[name], root, point) if name in own and {"cgroup", name} <= options else None
            )
            if folder is not None:
                folders[name] = folder
    return CgroupHierarchy(1, folders) if set(NEEDED) <= set(folders) else None


def _read_words(file: Path) -> list[str]:
    try:
        return file.read_text().split()
    except OSError:
        return []


@dataclass(frozen=True, slots=True)
class Cgroup:
    """Control group of one box."""

    version: int
    folders: Mapping[str, Path]

    @staticmethod
    def make(hierarchy: CgroupHierarchy, name: str, limits: BoxLimits) -> "Cgroup":
        """Makes the group afresh; what an evaluator that was killed left under this name is killed and removed.

        Raises OSError if the kernel refuses.
        """
        group = Cgroup(hierarchy.version, {key: folder / name for key, folder in hierarchy.folders.items()})
        group.remove(wait_s=1.0)
        for folder in group._group_folders():
            folder.mkdir()
        for controller, file, value in _limit_settings(hierarchy.version, limits):
            path = group.folders.get(controller, Path()) / file
            if controller in group.folders and (path.exists() or file not in OPTIONAL):
                path.write_text(str(value))
        return group

    def entries(self) -> tuple[int, ...]:
        """Files, opened: a process that writes "0" into each of them joins. The caller closes them."""
        return tuple(os.open(folder / "cgroup.procs", os.O_WRONLY | os.O_CLOEXEC) for folder in self._group_folders())

    def processes(self) -> set[int]:
        """Ids of the processes in the group."""
        return {int(pid) for folder in self._group_folders() for pid in _read_words(folder / "cgroup.procs")}

    def kill(self) -> None:
        """Send SIGKILL once to every process in the group."""
        for folder in self._group_folders():
            with suppress(OSError):
                (folder / "cgroup.kill").write_text("1")  # version 2 since Linux 5.14
        for pid in self.processes() - {os.getpid()}:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)

    def remove(self, wait_s: float) -> bool:
        """Kills and removes it. False if that did not come about in time: processes may take seconds to die."""
        end = time.monotonic() + wait_s
        while True:
            self.kill()
            for folder in self._group_folders():
                with suppress(OSError):
                    folder.rmdir()
            if not any(folder.exists() for folder in self._group_folders()):
                return True
            if time.monotonic() > end:
                return False
            time.sleep(PAUSE_S)

    def peak_memory_bytes(self) -> int | None:
        """Most memory in use at any time; None where the kernel does not say."""
        words = _read_words(
            self.folders["memory"] / ("memory.peak" if self.version == 2 else "memory.max_usage_in_bytes")
        )
        return int(words[0]) if words else None

    def cpu_s(self) -> float | None:
        """CPU time used by all processes [s]; None where the kernel does not say."""
        if self.version == 2:
            used_us = _read_number(self.folders["memory"] / "cpu.stat", "usage_usec")
            return None if used_us is None else used_us / 1e6
        words = _read_words(self.folders["cpuacct"] / "cpuacct.usage") if "cpuacct" in self.folders else []
        return int(words[0]) / 1e9 if words else None

    def oom_killed(self) -> bool:
        """Whether the kernel killed a process here for want of memory."""
        file = "memory.events" if self.version == 2 else "memory.oom_control"
        return bool(_read_number(self.folders["memory"] / file, "oom_kill"))

    def reached_own_limit(self) -> bool:
        """Whether memory ran out by the limit of this group, and not by that of a group around it or of the host."""
        if self.version == 2:
            events = self.folders["memory"] / "memory.events"
            return bool(_read_number(events, "oom") or _read_number(events, "max"))
        # Not `memory.failcnt`: Linux 6.18 leaves it at 0. A charge takes up to 64 pages at once.
        most, limit = (
            int(words[0]) if (words := _read_words(self.folders["memory"] / f"memory.{name}_in_bytes")) else 0
            for name in ("max_usage", "limit")
        )
        return most >= limit - CHARGE_BYTES

    def _group_folders(self) -> tuple[Path, ...]:
        return tuple(dict.fromkeys(self.folders.values()))


OPTIONAL = ("memory.swap.max", "memory.memsw.limit_in_bytes")
"""Absent where the kernel does not account swap."""


def _limit_settings(version: int, limits: BoxLimits) -> tuple[tuple[str, str, int | str], ...]:
    """Controller, file and value. One core for a box, whatever the number of its threads."""
    if version == 2:
        return (
            ("memory", "memory.max", limits.memory_bytes),
            ("memory", "memory.swap.max", 0),
            ("pids", "pids.max", limits.processes),
            ("cpu", "cpu.max", f"{PERIOD_US} {PERIOD_US}"),
        )
    return (
        ("memory", "memory.limit_in_bytes", limits.memory_bytes),
        ("memory", "memory.memsw.limit_in_bytes", limits.memory_bytes),
        ("pids", "pids.max", limits.processes),
        ("cpu", "cpu.cfs_period_us", PERIOD_US),
        ("cpu", "cpu.cfs_quota_us", PERIOD_US),
    )


def _read_number(file: Path, name: str) -> int | None:
    """The value of one row of a file of names and numbers."""
    words = _read_words(file)
    return int(words[words.index(name) + 1]) if name in words else None


PROCESSES = 1024
"""Processes and threads: far above what a worker starts; boxes are counted in groups of their own."""


def join_episode_group(memory_bytes: int) -> bool:
    """Move this process into a group of its own with this much memory, beside those of boxes.

    Returns False where no groups can be made (see `find_hierarchy`). A process that is in one already stays there.
    Raises OSError if the kernel refuses.
    """
    hierarchy = find_hierarchy()
    if hierarchy is None:
        return False
    # No share of the processor: unlike a box, a worker is trusted with its thread.
    hierarchy = replace(hierarchy, folders={key: hierarchy.folders[key] for key in ("memory", "pids")})
    remove_dead_episode_groups(hierarchy)
    name = f"{EPISODE_PREFIX}{os.getpid()}"
    if (hierarchy.folders["memory"] / name).is_dir():
        return True
    group = Cgroup.make(hierarchy, name, replace(BoxLimits(), memory_bytes=memory_bytes, processes=PROCESSES))
    for fd in group.entries():
        with os.fdopen(fd, "wb", buffering=0) as entry:
            entry.write(b"0")
    return True


def remove_dead_episode_groups(hierarchy: CgroupHierarchy | None = None) -> None:
    """Remove the groups of ended workers; the kernel keeps those that have processes.

    A live worker's group stays even if it is empty: the worker has made it and is about to join.
    """
    hierarchy = hierarchy or find_hierarchy()
    folders: set[Path] = set(hierarchy.folders.values()) if hierarchy is not None else set()
    for group in (member for folder in folders for member in folder.glob(f"{EPISODE_PREFIX}*")):
        if not Path("/proc", group.name.removeprefix(EPISODE_PREFIX)).exists():
            with suppress(OSError):
                group.rmdir()
