"""Calls for a subprocess of the server: top-level functions of a module that is imported at once. No tests in here."""

import time
from pathlib import Path

from mdrive_sumo.core.errors import InputError


def refuse() -> None:
    raise InputError("archive: expected better")


def noted_sleep(begun: Path) -> None:
    with begun.open("a") as file:
        file.write("x")
    time.sleep(600)
