"""Calls for a subprocess of the server: top-level functions of a module that is imported at once. No tests in here."""

import os
import time
from pathlib import Path

from mdrive_sumo.core.errors import InputError


def refuse() -> None:
    raise InputError("archive: expected better")


def noted_sleep(begun: Path) -> None:
    with begun.open("a") as file:
        file.write("x")
    time.sleep(600)


def end_by_signal(mark: Path, number: int, times: int) -> int:
    """Send a signal to this process, as somebody outside might, in the first calls; return how many there were."""
    with mark.open("a") as file:
        file.write("x")
    calls = mark.stat().st_size
    if calls <= times:
        os.kill(os.getpid(), number)
        time.sleep(60)
    return calls
