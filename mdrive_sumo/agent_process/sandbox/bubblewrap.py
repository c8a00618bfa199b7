"""Arguments of bubblewrap: what the box sees and what it loses."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePosixPath

from mdrive_sumo.agent_process.sandbox.box_spec import TAKEN, BoxSpec

AGENT_FD, ARGS_FD, SECCOMP_FD, STATUS_FD, FIRST_PROC_FD = 3, 4, 5, 6, 7
"""Numbers under which bubblewrap finds its descriptors; only the agent's reaches the agent."""

HOST_ETC = ("etc/alternatives", "etc/ld.so.cache")
"""Of the host's `/etc`, what its programs need to find their libraries; nothing about users or networks."""

NOT_OF_IMAGES = ("proc", "dev", "tmp", "sys", "run", "boot", "mnt", "media", "home", "root")
"""Folders of an image that a box makes itself or has no use for."""

ENVIRONMENT = {
    "PATH": "/usr/local/bin:/usr/bin:/bin",
    "HOME": "/tmp",
    "LANG": "C.UTF-8",
    "PYTHONDONTWRITEBYTECODE": "1",
    # A box has one core; a library that starts a thread for each core of the host runs into the limit of processes.
    **{f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")},
}


DEVICES = tuple(f"/dev/{name}" for name in ("null", "zero", "full", "random", "urandom", "tty"))
"""Of the host. Root stages them on read-only mounts, so that a program writes to the device but cannot set the times of
its file, which all boxes see. There are no terminals: their number is limited for all of the host."""

CHANGING = ("cpu MHz", "bogomips")
"""Of `/proc/cpuinfo`, what follows the load of the host."""


@cache
def list_proc_files() -> dict[str, bytes]:
    """Return all that a box has of `/proc`: what programs ask for and what never changes, by path.

    It has no process file system: each inode of one has a number that the kernel counts for all of the host, and its
    files tell of mounts, memory files and descriptors with more such numbers.
    """
    lines = Path("/proc/cpuinfo").read_text().splitlines(keepends=True)
    processors = "".join(line for line in lines if not line.lower().startswith(tuple(map(str.lower, CHANGING))))
    return {"/proc/cpuinfo": processors.encode(), "/proc/version": Path("/proc/version").read_bytes()}


def _describe_proc(spec: BoxSpec) -> Iterator[str]:
    """The words that make the files of `/proc`, and the link by which libraries beside a program are found."""
    for fd, name in enumerate(list_proc_files(), FIRST_PROC_FD):
        yield from ("--perms", "0444", "--file", str(fd), name)
    if spec.command[0].startswith("/"):
        yield from ("--symlink", spec.command[0], "/proc/self/exe")


def _describe_devices(seen: dict[str, Path]) -> Iterator[str]:
    """The words that make `/dev`: of staged devices alone, else of bubblewrap's own, which are mounts of the host's.

    bubblewrap's own beside the staged ones are eight mounts more, which took 2 ms.
    """
    staged = [inner for inner in DEVICES if inner in seen]
    if not staged:
        yield from ("--dev", "/dev", "--tmpfs", "/dev/pts", "--remount-ro", "/dev/pts")
        return
    yield from ("--tmpfs", "/dev", "--dir", "/dev/pts")
    for inner in staged:
        yield from ("--dev-bind", str(seen[inner]), inner)


def list_sources(spec: BoxSpec) -> dict[str, Path]:
    """Where the box will see which path of the host: programs, then the caller's files."""
    used = {PurePosixPath(inner).parts[1] for inner in spec.readonly.values()}
    root = spec.rootfs or Path("/")
    names = TAKEN if spec.rootfs is None else sorted(entry.name for entry in root.iterdir())
    programs = [name for name in names if name not in (*NOT_OF_IMAGES, *used, *(("etc",) if root == Path("/") else ()))]
    system = {f"/{name}": root / name for name in (*programs, *(HOST_ETC if spec.rootfs is None else ()))}
    system = {inner: outer for inner, outer in system.items() if outer.is_symlink() or outer.exists()}
    return system | {inner: outer.resolve() for outer, inner in spec.readonly.items()}


def find_hidden_paths(spec: BoxSpec) -> tuple[str, ...]:
    """Return where in the box the hidden folders would be seen."""
    folders = [path.resolve() for path in spec.hidden if path.is_dir()]
    if not folders:
        return ()
    shown = {inner: outer.resolve() for inner, outer in list_sources(spec).items() if not outer.is_symlink()}
    places = [
        str(PurePosixPath(inner) / path.relative_to(outer))
        for inner, outer in shown.items()
        for path in folders
        if path.is_relative_to(outer)
    ]
    return tuple(sorted(set(places)))


def find_working_folder(spec: BoxSpec) -> str:
    """Where the program begins: beside its own files, if it has some."""
    return "/agent" if "/agent" in spec.readonly.values() else "/tmp"


def list_arguments(spec: BoxSpec, seen: dict[str, Path]) -> tuple[str, ...]:
    """Everything after `--args`: namespaces, mounts, environment and the command.

    They go through a descriptor, because users of the host can read bubblewrap's command line.
    """
    mounts: list[str] = []
    for inner, outer in sorted(seen.items()):
        if inner in DEVICES:
            continue
        link = outer.is_symlink()
        mounts += ("--symlink", str(outer.readlink()), inner) if link else ("--ro-bind", str(outer), inner)
    for inner in find_hidden_paths(spec):
        mounts += ("--tmpfs", inner, "--remount-ro", inner)
    environment = ENVIRONMENT | dict(spec.env)
    size = str(spec.limits.tmp_bytes)
    return (
        *("--unshare-all", "--unshare-user", "--disable-userns", "--die-with-parent", "--new-session"),
        *("--cap-drop", "ALL", "--hostname", "agent", "--clearenv"),
        *mounts,
        *_describe_proc(spec),
        *_describe_devices(seen),
        *("--size", size, "--tmpfs", "/dev/shm", "--remount-ro", "/dev"),
        *("--size", size, "--tmpfs", "/tmp", "--remount-ro", "/"),
        *(word for name, value in environment.items() for word in ("--setenv", name, value)),
        *("--chdir", find_working_folder(spec)),
        *("--seccomp", str(SECCOMP_FD), "--json-status-fd", str(STATUS_FD)),
    )
