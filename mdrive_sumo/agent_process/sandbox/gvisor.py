"""gVisor (`runsc`): a kernel of its own for each box, between it and the host's."""

import json
import os
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdrive_sumo.agent_process.sandbox.box_spec import BoxSpec
from mdrive_sumo.agent_process.sandbox.bubblewrap import ENVIRONMENT, find_hidden_paths, find_working_folder
from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.core.posix import import_posix

if TYPE_CHECKING:
    import resource
else:
    resource = import_posix("resource")

FAST_PLATFORM, PLATFORM = "systrap", "ptrace"
"""How gVisor catches the system calls of a program. Both work everywhere, unprivileged too; `runsc` has systrap since
2023, and where it is offered it is taken. `kvm` was seen to hang on two hosts although the device was there: never."""

FLAGS_S = 10.0
"""Time limit of `runsc flags`, which takes 25 ms."""

OWN_THREADS = 256
OWN_MEMORY_BYTES = 128 << 20
"""What gVisor itself needs on the host, beside what runs in it; the control group counts both."""

CPU_GRACE_S = 5
"""CPU time that each of gVisor's processes may use beyond the program's limit [s]: it starts with 0.1 s, and answers
the program's system calls."""

BEGUN = b"."
SHIM = ("/bin/sh", "-c", f'printf {BEGUN.decode()} >&0; exec 3<&0 0</dev/null 1>&2; exec "$@"', "sh")
"""runsc passes only the three standard descriptors on, so the socket comes in as 0 and is renumbered inside. The first
byte says that the program begins: runsc's own failures would else pass for the program's."""


def add_own_use(limits: BoxLimits) -> BoxLimits:
    """Limits for the control group of a box."""
    processes, memory = limits.processes + OWN_THREADS, limits.memory_bytes + OWN_MEMORY_BYTES
    return replace(limits, processes=processes, memory_bytes=memory)


def list_outer_rlimits(limits: BoxLimits) -> tuple[tuple[int, int, int], ...]:
    """Which limit, soft and hard value, for each of gVisor's processes on the host.

    Of the limits inside, `runsc` 20221219 does not keep that of CPU time. A program computes in a process of the host,
    which the host's kernel ends.
    """
    cpu_s = limits.cpu_s + CPU_GRACE_S
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    cpu_s = cpu_s if hard == resource.RLIM_INFINITY or os.geteuid() == 0 else min(cpu_s, hard)
    return ((resource.RLIMIT_CPU, cpu_s, cpu_s), (resource.RLIMIT_CORE, 0, 0))


@lru_cache(maxsize=4)
def find_platform(program: str) -> str:
    """Return the platform that this `runsc` is started with, from what it says about its flags."""
    try:
        told = subprocess.run((program, "flags"), capture_output=True, text=True, check=False, timeout=FLAGS_S)
    except (OSError, subprocess.TimeoutExpired):
        return PLATFORM  # whatever is wrong with it is said when a box is opened
    return FAST_PLATFORM if FAST_PLATFORM in told.stdout + told.stderr else PLATFORM


def make_command(program: str, folder: Path) -> tuple[str, ...]:
    """Runs the bundle in this folder without root's rights and without a network."""
    state = ("--root", str(folder / "state"))
    return (
        *(program, "--rootless", "--network=none", f"--platform={find_platform(program)}", "--ignore-cgroups", *state),
        *("run", "--bundle", str(folder / "bundle"), folder.name),
    )


def write_bundle(
    spec: BoxSpec, originals: Mapping[str, Path], seen: dict[str, Path], folder: Path, uid: int | None
) -> None:
    """An OCI bundle: `config.json`, and a root that holds nothing but links and mount points."""
    root = folder / "bundle" / "rootfs"
    for path in (folder / "state", root, root / "proc", root / "dev", root / "tmp"):
        path.mkdir(parents=True, exist_ok=True)
    mounts = [_make_mount("/proc", "proc", "proc", "nosuid", "nodev", "noexec")]
    mounts.append(_make_mount("/dev", "tmpfs", "tmpfs", "nosuid"))  # read-only, even /dev/null could not be written to
    for inner in ("/tmp", "/dev/shm"):
        mounts.append(_make_mount(inner, "tmpfs", "tmpfs", "nosuid", "nodev", f"size={spec.limits.tmp_bytes}"))
    for inner, outer in sorted(seen.items()):
        place = root / inner.lstrip("/")
        place.parent.mkdir(parents=True, exist_ok=True)
        if outer.is_symlink():
            place.symlink_to(outer.readlink())
            continue
        place.touch() if originals[inner].is_file() else place.mkdir(exist_ok=True)
        mounts.append(_make_mount(inner, str(outer), "bind", "rbind", "ro", "nosuid", "nodev"))
    mounts += [_make_mount(inner, "tmpfs", "tmpfs", "ro", "nosuid", "nodev") for inner in find_hidden_paths(spec)]
    (folder / "bundle" / "config.json").write_text(json.dumps(_make_config(spec, mounts)))
    if uid is not None:
        for path in (folder, *folder.rglob("*")):
            os.chown(path, uid, uid, follow_symlinks=False)


def _make_config(spec: BoxSpec, mounts: list[dict[str, Any]]) -> dict[str, Any]:
    limits = spec.limits
    rlimits = {
        "RLIMIT_AS": limits.memory_bytes,
        "RLIMIT_NPROC": limits.processes,
        "RLIMIT_CPU": limits.cpu_s,
        "RLIMIT_FSIZE": limits.file_bytes,
        "RLIMIT_NOFILE": limits.open_files,
        "RLIMIT_CORE": 0,
    }
    nothing: list[str] = []
    return {
        "ociVersion": "1.0.0",
        "root": {"path": "rootfs", "readonly": True},
        "hostname": "agent",
        "process": {
            "terminal": False,
            "user": {"uid": 0, "gid": 0},
            "args": [*SHIM, *spec.command],
            "env": [f"{name}={value}" for name, value in (ENVIRONMENT | dict(spec.env)).items()],
            "cwd": find_working_folder(spec),
            "noNewPrivileges": True,
            "capabilities": dict.fromkeys(("bounding", "effective", "permitted", "inheritable", "ambient"), nothing),
            "rlimits": [{"type": name, "soft": value, "hard": value} for name, value in rlimits.items()],
        },
        "mounts": mounts,
        "linux": {"namespaces": [{"type": name} for name in ("pid", "network", "ipc", "uts", "mount")]},
    }


def _make_mount(inner: str, source: str, kind: str, *options: str) -> dict[str, Any]:
    return {"destination": inner, "source": source, "type": kind, "options": list(options)}
