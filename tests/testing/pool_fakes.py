"""Jobs that misbehave: top-level functions that worker processes can import. No tests in here."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError, WorldError


@dataclass(frozen=True)
class Task:
    """What a fake job shall do, and a folder to remember it in."""

    name: str
    deed: str = "answer"
    folder: str = ""


def perform(task: Task) -> str:
    """Does the task's deed; answers "<name> <pid>"."""
    if task.folder:
        (Path(task.folder) / f"{task.name}.started").write_text(str(os.getpid()))
    deeds.get(task.deed, lambda _: None)(task)
    return f"{task.name} {os.getpid()}"


def dies_answering(task: Task) -> bytes:
    """Its answer is too long to be sent before the other end reads; it is killed meanwhile."""
    (Path(task.folder) / f"{task.name}.started").write_text(str(os.getpid()))
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return bytes(2**24)


def _kill(_: Task) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _kill_first_time(task: Task) -> None:
    mark = Path(task.folder) / f"{task.name}.tried"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)


def _segfault(_: Task) -> None:
    ctypes.string_at(0)


def _leave(_: Task) -> None:
    os._exit(7)


def _raise(_: Task) -> None:
    raise ZeroDivisionError("no\nnumber")


def _input(_: Task) -> None:
    raise InputError("the map: expected a road, found the sea")


def _full(_: Task) -> None:
    with Path("/dev/full").open("w") as file:
        file.write("x")


def _hang(_: Task) -> None:
    time.sleep(600)


def _hang_once(task: Task) -> None:
    mark = Path(task.folder) / f"{task.name}.tried"
    if not mark.exists():
        mark.touch()
        time.sleep(600)


def _hang_with_child(task: Task) -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    (Path(task.folder) / "child").write_text(str(child.pid))
    time.sleep(600)


def _interrupt_self(_: Task) -> None:
    os.kill(os.getpid(), signal.SIGINT)


def _nap(_: Task) -> None:
    time.sleep(0.3)


def _world(_: Task) -> None:
    raise WorldError("SUMO lost the road")


deeds = {
    "kill": _kill,
    "kill first time": _kill_first_time,
    "segfault": _segfault,
    "leave": _leave,
    "raise": _raise,
    "input": _input,
    "full": _full,
    "hang": _hang,
    "hang once": _hang_once,
    "hang with child": _hang_with_child,
    "interrupt self": _interrupt_self,
    "nap": _nap,
    "world": _world,
}
