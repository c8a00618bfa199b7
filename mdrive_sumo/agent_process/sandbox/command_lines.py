"""The three backends: how a described program becomes a launch."""

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import bubblewrap, gvisor, seccomp
from mdrive_sumo.agent_process.sandbox.box_spec import BoxSpec
from mdrive_sumo.agent_process.sandbox.launch import STAGE, LaunchPlan, StatWatch, make_program
from mdrive_sumo.agent_process.sandbox.limits import list_rlimits
from mdrive_sumo.agent_process.sandbox.pipe_ends import PipeEnds
from mdrive_sumo.agent_process.sandbox.supervisor_process import request_supervisor
from mdrive_sumo.core.errors import InputError

CAP_SYS_ADMIN = 1 << 21
"""Its bit in the masks of `/proc/self/status`. Source: `linux/capability.h`."""


@dataclass(frozen=True, slots=True)
class BoxPlacement:
    """Where a box runs, and under which user and group."""

    uid: int | None
    """None: as the user who starts it."""
    entries: tuple[int, ...]
    """Open `cgroup.procs` files of its control group."""
    folder: Path | None
    """A temporary folder that lasts as long as the box; only gVisor needs one."""
    seen: Mapping[str, Path]
    """Where the box sees which path of the host."""


def plan_launch(spec: BoxSpec, ends: PipeEnds, place: BoxPlacement) -> LaunchPlan:
    """What to start. Raises InputError if the backend cannot be had here."""
    return {"bubblewrap": _plan_bubblewrap, "gvisor": _plan_gvisor, "none": _plan_unboxed}[spec.backend](
        spec, ends, place
    )


def _plan_bubblewrap(spec: BoxSpec, ends: PipeEnds, place: BoxPlacement) -> LaunchPlan:
    program = find_program("bwrap", "bubblewrap")
    seen, staged = _plan_staging(place.seen, bubblewrap.DEVICES)
    words = "\0".join(bubblewrap.list_arguments(spec, seen)).encode()
    first = (ends.nothing, ends.log_writing, ends.log_writing, ends.agent.fileno())
    proc = (ends.in_memory(text) for text in bubblewrap.list_proc_files().values())
    descriptors = (*first, ends.in_memory(words), ends.in_memory(seccomp.compile_filter()), ends.status_writing, *proc)
    argv = (program, "--args", str(bubblewrap.ARGS_FD), "--", *spec.command)
    limits = list_rlimits(spec.limits, own_uid=place.uid is not None, grouped=bool(place.entries))
    watch = _plan_watch(ends, place)
    return LaunchPlan(argv, {}, descriptors, limits, place.entries, place.uid, staged, watch=watch)


def _plan_watch(ends: PipeEnds, place: BoxPlacement) -> StatWatch:
    stat_filter = seccomp.compile_stat_filter()
    link = ends.undo.enter_context(request_supervisor(place.uid, stat_filter.fstat, place.entries))
    return StatWatch(make_program(stat_filter.program), stat_filter.seccomp, link)


def _plan_gvisor(spec: BoxSpec, ends: PipeEnds, place: BoxPlacement) -> LaunchPlan:
    """gVisor's own kernel keeps most limits inside; of the outer ones it bears the control group and the CPU time."""
    program, folder = find_program("runsc", "gvisor"), place.folder
    assert folder is not None
    seen, staged = _plan_staging(place.seen)
    gvisor.write_bundle(spec, place.seen, seen, folder, place.uid)
    descriptors = (ends.agent.fileno(), ends.log_writing, ends.log_writing)
    env = {"PATH": os.defpath, "TMPDIR": str(folder)}
    limits = gvisor.list_outer_rlimits(spec.limits)
    return LaunchPlan(gvisor.make_command(program, folder), env, descriptors, limits, place.entries, place.uid, staged)


def _plan_unboxed(spec: BoxSpec, ends: PipeEnds, _place: BoxPlacement) -> LaunchPlan:
    """No box and no limits: the same program with the paths of the outside."""
    words = [_to_host_path(word, spec) for word in spec.command]
    argv = (shutil.which(words[0]) or words[0], *words[1:])
    values = bubblewrap.ENVIRONMENT | dict(spec.env)
    env = {name: ":".join(_to_host_path(word, spec) for word in text.split(":")) for name, text in values.items()}
    first = (ends.nothing, ends.log_writing, ends.log_writing, ends.agent.fileno())
    return LaunchPlan(argv, env, first, (), nice=0, cwd=_to_host_path(bubblewrap.find_working_folder(spec), spec))


def _plan_staging(
    seen: Mapping[str, Path], devices: tuple[str, ...] = ()
) -> tuple[dict[str, Path], tuple[tuple[Path, str], ...]]:
    """What the box sees where, and what is bound below `STAGE` for that, while still root."""
    if not may_mount():
        return dict(seen), ()
    bound = [(inner, outer) for inner, outer in seen.items() if not outer.is_symlink()]
    bound += [(device, Path(device)) for device in devices]
    places = {inner: STAGE / str(i) for i, (inner, _) in enumerate(bound)}
    return dict(seen) | places, tuple((outer, str(i)) for i, (_, outer) in enumerate(bound))


def may_mount() -> bool:
    """Whether this process is root with the right to mount."""
    rows = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":\t" in line)
    return os.geteuid() == 0 and bool(int(rows["CapEff"], 16) & CAP_SYS_ADMIN)


def find_program(name: str, backend: str) -> str:
    """Return the path of a backend's program. Raises InputError."""
    path = shutil.which(name)
    if path is None:
        raise InputError(f"sandbox: the backend {backend} needs the program {name}, which is not installed here")
    return path


def _to_host_path(word: str, spec: BoxSpec) -> str:
    """A path of the box as it is without one; other words stay."""
    for outer, inner in sorted(spec.readonly.items(), key=lambda row: -len(row[1])):
        if word == inner or word.startswith(inner + "/"):
            return str(outer) + word[len(inner) :]
    return word
