"""What a box has around it on this machine, as seen in one that is opened for that."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import bubblewrap, cgroups
from mdrive_sumo.agent_process.sandbox.box import Box
from mdrive_sumo.agent_process.sandbox.box_spec import BoxSpec
from mdrive_sumo.agent_process.sandbox.command_lines import may_mount
from mdrive_sumo.agent_process.sandbox.kernel_trial import AUTO, OWN_KERNEL, choose_backend, try_own_kernel
from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.agent_process.sandbox.open_box import open_in_any_thread
from mdrive_sumo.agent_process.sandbox.private_files import FOLDER, MEMORY, find_file_system
from mdrive_sumo.agent_process.sandbox.refused_calls import REFUSALS
from mdrive_sumo.agent_process.sandbox.user_slots import FIRST_UID
from mdrive_sumo.core.errors import InputError, WorldError

LAYERS = (
    *("namespaces", "read-only", "privileges", "seccomp", "private-files", "proc", "uid", "cgroup", "rlimits"),
    "own-kernel",
)
NAMESPACES = ("cgroup", "ipc", "mnt", "net", "pid", "user", "uts")
LOOK = f"""
if [ -r /proc/self/status ]; then
  for name in {" ".join(NAMESPACES)}; do echo "ns-$name $(readlink /proc/self/ns/$name)"; done
  while read -r name value rest; do case $name in CapEff:|CapBnd:|NoNewPrivs:|Seccomp:) echo "$name $value"; esac
  done </proc/self/status
fi
read -r kernel </proc/version; echo "kernel $kernel"
echo "open-files $(ulimit -n)"
for name in sys/fs/aio-nr sys/kernel/osrelease meminfo locks loadavg 1/mem self/mountinfo
do if ( read -r word </proc/$name ) 2>&-; then echo "told $name"; fi; done
if ( : >/left-over ) 2>&-; then echo "root writable"; else echo "root read-only"; fi
echo looked >&3; read -r wait <&3
"""
"""What a shell in a box reads about itself; then it waits to be looked at from outside."""

WAIT_S = 10.0

TIMING_GAP = (
    "what boxes tell each other by timing: CPU, memory and caches are shared"
    " (docs/sandbox-channels.md, Residual channels)"
)
GAPS = {
    "bubblewrap": (
        "faults of the kernel, which all boxes share with the host (for a public event use gVisor or a machine each)",
        TIMING_GAP,
        "the numbers of the devices on which a box's own temporary folders lie: they tell how many boxes live",
        "what a program keeps in its own temporary folder while its box lasts",
        "GPU devices, which no box is given",
    ),
    "gvisor": (
        TIMING_GAP,
        "faults of gVisor together with faults of the host's kernel",
        "GPU devices, which no box is given",
    ),
    "none": ("anything: the program runs as the user who started it",),
}
"""What a backend does not protect from."""


@dataclass(frozen=True, slots=True)
class SandboxLayer:
    """One mechanism, and whether boxes on this machine have it."""

    name: str
    active: bool
    detail: str
    """How, or why not."""


def list_shown_paths(rootfs: Path | None = None) -> frozenset[Path]:
    """Paths of the host that every box sees whole, whatever its caller shows it."""
    seen = bubblewrap.list_sources(BoxSpec(("true",), {}, rootfs=rootfs)).values()
    return frozenset(path.resolve() for path in seen if not path.is_symlink())  # links are made anew inside


def examine_layers(backend: str = "bubblewrap", copies: Path = MEMORY) -> tuple[SandboxLayer, ...]:
    """Opens a box of this backend, looks around in it, and says what was found.

    copies: where boxes get files of their own; if that is not possible, a box without them is examined.
    """
    limits = BoxLimits()
    spec = BoxSpec(("/bin/sh", "-c", LOOK), {}, limits=limits, backend=backend, copies=copies)
    try:
        box, problem = _open_with_copies(spec)
    except (InputError, WorldError) as error:
        return _make_missing_layers(str(error))
    try:
        with box:  # closed, it says why it ended, if it failed while it was looked at
            box.ready(WAIT_S)
            outside = _look_from_outside(find_program(box.pid))
            told = box.log().decode(errors="replace")
    except WorldError as error:
        return _make_missing_layers(str(error))
    seen = (outside if backend == "bubblewrap" else {}) | _parse_rows(told)
    return (
        *_examine_all(seen, backend),
        _examine_files(seen, backend, copies, problem),
        _examine_proc(told, backend),
        _examine_uid(outside),
        _examine_cgroup(),
        _examine_rlimits(seen, limits),
        _examine_kernel(seen, backend),
        *_examine_optional(),
    )


def find_program(pid: int) -> int:
    """Return the last of the processes that began each other, from this one on."""
    parents: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(path.read_text().rpartition(")")[2].split()[1])] = int(path.parent.name)
    while pid in parents:
        pid = parents[pid]
    return pid


def _look_from_outside(pid: int) -> dict[str, str]:
    """Return what the host's `/proc` tells of a process in a box, which may have no `/proc` itself.

    Raises WorldError if the process has ended.
    """
    folder = Path(f"/proc/{pid}")
    try:
        namespaces = {f"ns-{name}": str((folder / "ns" / name).readlink()) for name in NAMESPACES}
        mounts = (line.split()[3:5] for line in (folder / "mountinfo").read_text().splitlines())
        status = (folder / "status").read_text().replace("\t", " ")
    except OSError as error:
        raise WorldError(f"sandbox: a box ended while it was looked at: {error.strerror}") from None
    programs = next((root for root, place in mounts if place == "/usr"), "")
    return _parse_rows(status) | namespaces | {"usr": programs}


def examine_backend(wanted: str = AUTO, copies: Path = MEMORY) -> tuple[str, tuple[SandboxLayer, ...]]:
    """Return the backend that boxes have on this machine, see `choose_backend`, and its layers."""
    backend = choose_backend(wanted)
    return backend, examine_layers(backend, copies)


def _open_with_copies(spec: BoxSpec) -> tuple[Box, str]:
    """Return a box, and why it has no files of its own ("" if it has)."""
    try:
        return open_in_any_thread(spec), ""
    except InputError as error:
        return open_in_any_thread(replace(spec, copies=None)), str(error)


def _examine_files(seen: Mapping[str, str], backend: str, copies: Path, problem: str) -> SandboxLayer:
    """gVisor shows no roots of mounts; there it counts that the copies could be made."""
    own = not problem and (backend == "gvisor" or FOLDER in seen.get("usr", ""))
    if not own:
        return SandboxLayer("private-files", False, problem or "boxes share the host's files")
    kind = find_file_system(copies)
    warnings = (
        [] if kind == "tmpfs" else [f"{kind} is no tmpfs: a later box in a slot can learn what an earlier one read"]
    )
    if backend == OWN_KERNEL and not may_mount():
        warnings.append("started by a plain user, a later box in a slot sees when files were last read")
    if kind == "tmpfs" and len(Path("/proc/swaps").read_text().splitlines()) > 1:
        warnings.append("this host swaps, which a box can notice: switch swap off")
    return SandboxLayer("private-files", True, "; ".join((f"copies for each slot in {copies} ({kind})", *warnings)))


def _examine_proc(told: str, backend: str) -> SandboxLayer:
    """Of gVisor's own kernel, /proc tells nothing of the host."""
    open_names = [line.partition(" ")[2] for line in told.splitlines() if line.startswith("told ")]
    if backend == "gvisor":
        return SandboxLayer("proc", True, "of gVisor's own kernel")
    how = (
        f"/proc tells {', '.join(open_names)}" if open_names else "no process file system; two files that never change"
    )
    return SandboxLayer("proc", not open_names, how)


def _parse_rows(text: str) -> dict[str, str]:
    return dict(line.split(" ", 1) for line in text.splitlines() if " " in line)


def _make_missing_layers(problem: str) -> tuple[SandboxLayer, ...]:
    """No box, no layers."""
    return (*(SandboxLayer(name, False, problem) for name in LAYERS), *_examine_optional())


def _examine_all(seen: Mapping[str, str], backend: str) -> tuple[SandboxLayer, ...]:
    """gVisor's kernel shows nothing of the host's, so that it is another one is all that can be seen of its walls."""
    walled = _has_own_kernel(seen, backend)
    outside = {name: str(Path(f"/proc/self/ns/{name}").readlink()) for name in NAMESPACES}
    shared = [name for name in NAMESPACES if seen.get(f"ns-{name}", "") in ("", outside[name])]
    capabilities = {seen.get("CapEff:"), seen.get("CapBnd:")}
    bare = capabilities == {"0" * 16} and (walled or seen.get("NoNewPrivs:") == "1")
    root = seen.get("root", "not looked at")
    filtered = walled or seen.get("Seccomp:") == "2"
    how = "gVisor's own kernel" if walled else f"{backend}; shared with the host: {', '.join(shared) or 'none'}"
    return (
        SandboxLayer("namespaces", walled or not shared, how),
        SandboxLayer("read-only", root == "read-only", f"root of the box is {root}, temporary folders are sized"),
        SandboxLayer("privileges", bare, "no capabilities, no gain by set-uid programs" if bare else "some are left"),
        SandboxLayer("seccomp", filtered, _describe_filter(walled) if filtered else "no filter in force"),
    )


def _has_own_kernel(seen: Mapping[str, str], backend: str) -> bool:
    host = Path("/proc/version").read_text().strip()
    return backend == OWN_KERNEL and seen.get("kernel", host) != host


def _examine_kernel(seen: Mapping[str, str], backend: str) -> SandboxLayer:
    if _has_own_kernel(seen, backend):
        return SandboxLayer("own-kernel", True, "gVisor's, one for each box")
    trial = try_own_kernel()
    why_not = f"could be had from gVisor: {trial.detail}" if trial.succeeded else trial.detail
    return SandboxLayer("own-kernel", False, f"boxes share the host's kernel; {why_not}")


def _describe_filter(walled: bool) -> str:
    refused = sum(len(rule.calls) for rule in REFUSALS)
    text = f"{refused} system calls refused, among them all locks and watches of files; fstat answered by a supervisor"
    return "system calls end in gVisor's own kernel" if walled else text


def _examine_uid(outside: Mapping[str, str]) -> SandboxLayer:
    uid = outside.get("Uid:", "").partition(" ")[0]
    own = uid.isdigit() and int(uid) >= FIRST_UID and os.geteuid() == 0
    how = f"{FIRST_UID} + slot" if own else "all boxes run as the user who starts them; only root can change that"
    return SandboxLayer("uid", own, how)


def _examine_cgroup() -> SandboxLayer:
    hierarchy = cgroups.find_hierarchy()
    why_not = "none writable with memory and pids: memory is limited for each process only, not for all together"
    return SandboxLayer("cgroup", hierarchy is not None, hierarchy.describe() if hierarchy else why_not)


def _examine_rlimits(seen: Mapping[str, str], limits: BoxLimits) -> SandboxLayer:
    open_files = seen.get("open-files", "")
    how = "processes, CPU time, file size, open files, no core files"
    return SandboxLayer("rlimits", open_files == str(limits.open_files), how)


def _examine_optional() -> tuple[SandboxLayer, ...]:
    how = "the host's /usr, or an unpacked image where one is named"
    return (SandboxLayer("rootfs", Path("/usr").is_dir(), how),)


def check_layers(required: Sequence[str], backend: str = "bubblewrap", copies: Path = MEMORY) -> tuple[str, ...]:
    """What boxes of this backend have here. Raises InputError, one sentence, if they lack any of these layers."""
    layers = {layer.name: layer for layer in examine_layers(backend, copies)}
    unknown = [name for name in required if name not in layers]
    if unknown:
        raise InputError(f"sandbox: expected layers among {', '.join(layers)}, found {', '.join(unknown)}")
    missing = [layers[name] for name in required if not layers[name].active]
    if missing:
        lacks = "; ".join(f"{layer.name} ({layer.detail})" for layer in missing)
        raise InputError(f"sandbox: expected the layers {', '.join(required)} on this machine, found no {lacks}")
    return tuple(name for name in LAYERS if layers[name].active)
