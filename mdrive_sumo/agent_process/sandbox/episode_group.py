"""The control group of an evaluator's process: simulation, sensors and frames of one worker have a ceiling too."""

import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from mdrive_sumo.agent_process.sandbox.cgroups import EPISODE_PREFIX, Cgroup, CgroupHierarchy, find_hierarchy
from mdrive_sumo.agent_process.sandbox.limits import BoxLimits

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
    for group in (each for folder in folders for each in folder.glob(f"{EPISODE_PREFIX}*")):
        if not Path("/proc", group.name.removeprefix(EPISODE_PREFIX)).exists():
            with suppress(OSError):
                group.rmdir()
