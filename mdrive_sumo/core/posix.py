"""What Python does not have on Windows: what needs it says so in one sentence, everything else works."""

import os
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NoReturn

from mdrive_sumo.core.errors import InputError

REMEDY = "needs Linux; on Windows use WSL2"


def find_open_flags(*names: str) -> int:
    """Return flags of `os.open` together; those that this system lacks are left out.

    `O_BINARY` is among them where there is one: without it Windows changes the line ends of what is written.
    """
    flags = 0
    for name in (*names, "O_BINARY"):
        flags |= getattr(os, name, 0)
    return flags


def is_posix() -> bool:
    """Return whether this system has what processes of workers and agents need."""
    try:
        return find_spec("fcntl") is not None
    except (ImportError, ValueError):
        return False


def check_posix(what: str) -> None:
    """Raise InputError unless this system has what processes of workers and agents need. what: begins the sentence."""
    if not is_posix():
        raise InputError(f"{what} {REMEDY}")


class MissingModule:
    """Stands for a module that this system does not have: every use of it raises InputError."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> NoReturn:
        """Raises InputError."""
        raise InputError(f"{self._name}.{attribute}: this {REMEDY}")


def import_posix(name: str) -> Any:
    """Return a module of POSIX systems, or what stands for it elsewhere."""
    try:
        return import_module(name)
    except ImportError:
        return MissingModule(name)
