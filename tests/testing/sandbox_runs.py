"""Runs the programs of `hostile/agents` in boxes, and looks for what they left behind."""

import json
import os
import shutil
import socket
import stat
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdrive_sumo.agent_process.sandbox import Box, BoxLimits, BoxReport, BoxSpec, open_box
from mdrive_sumo.agent_process.sandbox.box_spec import SLOTS
from mdrive_sumo.agent_process.sandbox.cgroups import find_hierarchy
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID
from testing.paths import TESTS

AGENTS = TESTS / "hostile" / "agents"
MEBIBYTE = 1024**2
SMALL = BoxLimits(
    memory_bytes=96 * MEBIBYTE,
    processes=24,
    cpu_s=30,
    file_bytes=2 * MEBIBYTE,
    tmp_bytes=8 * MEBIBYTE,
)
needs_bubblewrap = pytest.mark.skipif(shutil.which("bwrap") is None, reason="needs bubblewrap")
PATIENCE_S = 60.0
"""The machine may be busy; nothing here is expected to need it."""


def needs_root() -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root")


def own_slot() -> int:
    """A slot that, with the one after it, no other file of tests and no other process of them uses.

    Held by a name as slots are, so until this process ends; the first ones are left to callers that take any.
    """
    for number in range(SLOTS // 2, SLOTS, 2):
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            lock.bind(f"\0mdrive-sumo-tests-{number}")
        except OSError:
            lock.close()
        else:
            lock.detach()
            return number
    raise RuntimeError("all slots for tests are held by other processes")


def reachable(folder: Path) -> Path:
    """Lets the user of a box into a folder: pytest closes those around its own."""
    for path in (folder, *folder.parents):
        if not path.stat().st_mode & stat.S_IXOTH:
            path.chmod(0o755)
    return folder


@dataclass(frozen=True, slots=True)
class Ended:
    """What a program told, printed, and how its box ended."""

    told: dict[str, Any]
    log: bytes
    report: BoxReport


@dataclass(frozen=True, slots=True)
class Expected:
    """One hostile program and what must come of it."""

    limits: BoxLimits = SMALL
    told: dict[str, Any] = field(default_factory=dict)
    """Exactly this."""
    at_most: dict[str, int] = field(default_factory=dict)
    """Numbers it told, and what bounds them."""
    exit_code: int | None = None
    signals: tuple[int | None, ...] = (None,)
    oom: bool = False
    stays: bool = False
    """It does not end by itself: the box is closed when it has told something."""
    slow: bool = False
    needs: tuple[str, ...] = ()
    """Layers without which the verdict cannot be had."""


def python_spec(program: str, *arguments: str, **more: Any) -> BoxSpec:
    """A program of `AGENTS` with this interpreter and its numpy."""
    readonly = {
        Path(sys.base_prefix): "/opt/python",
        Path(np.__file__).parents[1]: "/opt/site",
        AGENTS: "/agent",
        **more.pop("readonly", {}),
    }
    name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    command = (f"/opt/python/bin/{name}", f"/agent/{program}.py", *arguments)
    return BoxSpec(command, readonly, env={"PYTHONPATH": "/opt/site"}, **more)


def shell_spec(text: str, **more: Any) -> BoxSpec:
    """A line of a shell."""
    return BoxSpec(("/bin/sh", "-c", text), **{"readonly": {}, **more})


def run(spec: BoxSpec, stays: bool = False) -> Ended:
    """Opens a box, listens until it falls silent for good, closes it. Nobody else sends signals to its program."""
    lines = b""
    with open_box(replace(spec, owns_signals=True)) as box:
        end = time.monotonic() + PATIENCE_S
        while not (stays and lines) and box.ready(end - time.monotonic()):
            data = box.socket.recv(65536)
            if not data:
                break
            lines += data
        while not stays and box.alive() and time.monotonic() < end:
            box.pump()
            time.sleep(0.01)
        log = box.log()
        report = box.close()
    told: dict[str, Any] = {}
    for line in lines.splitlines():
        told |= json.loads(line)
    return Ended(told, log, report)


def left_behind(slot: int) -> list[str]:
    """Processes and control groups of a slot whose box is closed.

    Groups are looked for inside the own one only: elsewhere may stand those of a test run that was killed.
    """
    hierarchy = find_hierarchy()
    own = set(hierarchy.folders.values()) if hierarchy else set()
    groups = [str(folder / f"mdrive-box-{slot}") for folder in own if (folder / f"mdrive-box-{slot}").exists()]
    return groups + [str(pid) for pid in processes_of(FIRST_UID + slot)]


def find_supervisor(box: Box) -> int:
    """The process of a slot's user that is not of the box: it sees the processes of the host. Needs root."""
    own = os.stat("/proc/self/ns/pid").st_ino  # noqa: PTH116
    found = [
        pid
        for pid in processes_of(FIRST_UID + box.slot)
        if (
            Path(f"/proc/{pid}/ns/pid").stat().st_ino == own
            and "supervisor" in Path(f"/proc/{pid}/cmdline").read_text()
        )
    ]
    assert len(found) == 1
    return found[0]


def processes_of(uid: int) -> list[int]:
    """All processes of a user that are not dead (the host's first process may be slow to collect those)."""
    found: list[int] = []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
            if entry.stat().st_uid == uid and state not in "ZX":
                found.append(int(entry.name))
    return found
