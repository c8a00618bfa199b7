"""Jobs of a module that could drive, as far as imports show. No tests in here."""

import os
import sys
from pathlib import Path

from mdrive_sumo.loop import run_episode
from testing.pool_fakes import Task

__all__ = ["describe_process", "run_episode"]


def describe_process(task: Task) -> tuple[int, int, bool, bool]:
    """Its parent, its number of threads, whether libsumo is imported, and whether it has a simulation.

    With the name "drive" it then starts a simulation and leaves it open.
    """
    is_imported = "libsumo" in sys.modules
    import libsumo

    seen = os.getppid(), len(list(Path("/proc/self/task").iterdir())), is_imported, bool(libsumo.isLoaded())
    if task.name == "drive":
        libsumo.start(["sumo", "--net-file", task.folder, "--no-step-log", "true"])
    return seen
