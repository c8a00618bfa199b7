"""Opens a box: from a description to a running program."""

import os
import shutil
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import bubblewrap, cgroups, gvisor
from mdrive_sumo.agent_process.sandbox.box import Box, BoxParts
from mdrive_sumo.agent_process.sandbox.box_spec import BoxSpec
from mdrive_sumo.agent_process.sandbox.command_lines import BoxPlacement, plan_launch
from mdrive_sumo.agent_process.sandbox.launch import BoxError, start
from mdrive_sumo.agent_process.sandbox.pipe_ends import LogRing, PipeEnds
from mdrive_sumo.agent_process.sandbox.private_files import provide_private_files
from mdrive_sumo.agent_process.sandbox.user_slots import UserSlot, take_slot
from mdrive_sumo.core.posix import check_posix

GVISOR_START_S = 30.0
"""Most that gVisor may take to begin a program [s]; measured 0.2 s, and 1.3 s at load 12."""


def open_box(spec: BoxSpec) -> Box:
    """Starts the program in a box of its own.

    Only from the main thread: the kernel ends a box with the *thread* that started it. Raises InputError if what was
    asked for cannot be had here (never a weaker box instead), BoxError if the box could not be started.
    """
    if threading.current_thread() is not threading.main_thread():
        raise RuntimeError("a box ends with the thread that opens it: open it in the main thread of its process")
    return open_in_any_thread(spec)


def open_in_any_thread(spec: BoxSpec, start_s: float = GVISOR_START_S) -> Box:
    """As `open_box`, from any thread; the box must be closed before the thread ends.

    start_s: time limit for gVisor's kernel to begin the program.
    """
    check_posix("a box")
    with ExitStack() as undo:
        slot = take_slot(spec.slot)
        undo.callback(slot.release, clean=True)
        group = _make_group(spec, slot)
        if group is not None:
            undo.callback(group.remove, 1.0)
        folder = _make_folder(slot) if spec.backend == "gvisor" else None
        if folder is not None:
            undo.callback(shutil.rmtree, folder, ignore_errors=True)
        box = _start(spec, slot, group, folder)
        undo.pop_all()
    if spec.backend == "gvisor":
        _wait_for_begin(box, start_s)
    return box


def _make_folder(slot: UserSlot) -> Path:
    """A temporary folder for a box in this slot; removes those of earlier ones, whose evaluators were killed."""
    prefix = f"mdrive-box-{os.geteuid()}-{slot.number}-"
    for left_over in Path(tempfile.gettempdir()).glob(f"{prefix}*"):
        with suppress(OSError):
            if left_over.lstat().st_uid in (slot.uid, os.geteuid()):  # not what another user has put there
                shutil.rmtree(left_over, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=prefix))


def _wait_for_begin(box: Box, start_s: float) -> None:
    """Until gVisor has started the program, which may take seconds."""
    in_time = box.ready(start_s)
    if in_time and box.socket.recv(1) == gvisor.BEGUN:
        return
    with suppress(BoxError):  # what follows says more
        box.close()
    why = box.log().decode(errors="replace").strip() if in_time else f"not within {start_s:g} s"
    raise BoxError(f"sandbox: gVisor did not start: {why}")


def _make_group(spec: BoxSpec, slot: UserSlot) -> cgroups.Cgroup | None:
    hierarchy = None if spec.backend == "none" else cgroups.find_hierarchy()
    if hierarchy is None:
        return None
    limits = gvisor.add_own_use(spec.limits) if spec.backend == "gvisor" else spec.limits
    try:
        return cgroups.Cgroup.make(hierarchy, f"mdrive-box-{slot.number}", limits)
    except OSError as error:
        raise BoxError(f"sandbox: no control group for slot {slot.number}: {error}") from error


def _start(spec: BoxSpec, slot: UserSlot, group: cgroups.Cgroup | None, folder: Path | None) -> Box:
    ends = PipeEnds.make()
    with ends.theirs, ends.undo:
        if spec.backend == "gvisor":
            ends.widen_log()
        entries = () if group is None else group.entries()
        for fd in entries:
            ends.theirs.callback(os.close, fd)
        seen = provide_private_files(spec, slot.number) if spec.copies is not None else bubblewrap.list_sources(spec)
        plan = plan_launch(spec, ends, BoxPlacement(slot.uid, entries, folder, seen))
        pid = start(plan)
        parts = BoxParts(
            pid=pid,
            pidfd=os.pidfd_open(pid),
            status=ends.status,
            supervisor=None if plan.watch is None else plan.watch.link,
            slot=slot,
            group=group,
            began=time.monotonic(),
            folder=folder,
            cpu_limit_s=spec.limits.cpu_s,
            owns_signals=spec.owns_signals,
        )
        ends.undo.pop_all()
    return Box(parts, ends.own, LogRing(ends.log, spec.limits.log_bytes), spec.backend)
