"""What is to run in a box."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.core.errors import InputError

BACKENDS = ("bubblewrap", "gvisor", "none")

SLOTS = 1000
"""Places for boxes on one host; slot n runs as uid 60001 + n, which must stay below the uids of other services."""

TAKEN = ("usr", "bin", "sbin", "lib", "lib32", "lib64", "libx32", "etc", "proc", "dev", "tmp", "sys")
"""Folders of the box's root that are not the caller's to fill."""


@dataclass(frozen=True, slots=True)
class BoxSpec:
    """One program to run in a box of its own; it finds its end of the socket as file descriptor 3."""

    command: tuple[str, ...]
    """As seen inside the box."""
    readonly: Mapping[Path, str]
    """Files and folders outside, and the absolute path at which the box sees each of them, read-only."""
    env: Mapping[str, str] = field(default_factory=dict[str, str])
    limits: BoxLimits = field(default_factory=BoxLimits)
    slot: int | None = None
    """Place on this host; None takes any that is free."""
    backend: str = "bubblewrap"
    rootfs: Path | None = None
    """Unpacked container image whose programs the box sees; None: this host's `/usr`."""
    copies: Path | None = None
    """Folder, best in memory, where the box gets copies of all files that it sees; None: it sees the host's own, which
    all boxes then share. With copies the host's `/usr` is reduced to the interpreter and what it loads."""
    live: frozenset[str] = frozenset()
    """Paths of the box whose files the caller changes while it runs: never copied."""
    hidden: tuple[Path, ...] = ()
    """Folders outside that appear empty wherever they lie in what the box sees; those that do not exist are ignored.
    The backend `none` hides nothing."""
    owns_signals: bool = False
    """Whether a signal that may have come from outside counts as the program's own: when its run is repeated because of
    one, so that a program that kills itself cannot have its run repeated again and again."""

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise InputError(f"sandbox: expected the backend {', '.join(BACKENDS)}, found {self.backend!r}")
        if self.slot is not None and not 0 <= self.slot < SLOTS:
            raise InputError(f"sandbox: expected a slot from 0 to {SLOTS - 1}, found {self.slot}")
        if self.rootfs is not None and not (self.rootfs / "usr").is_dir():
            raise InputError(f"sandbox: expected an unpacked image with a folder usr in {self.rootfs}, found none")
        for outer, inner in self.readonly.items():
            _check_mount(outer, inner)
        _check_command(self)


def _check_mount(outer: Path, inner: str) -> None:
    path = PurePosixPath(inner)
    if str(path) != inner or not path.is_absolute() or ".." in path.parts or len(path.parts) < 2:
        raise InputError(f"sandbox: expected an absolute path inside the box for {outer}, found {inner!r}")
    if path.parts[1] in TAKEN:
        raise InputError(f"sandbox: {inner} is not free inside the box, choose a path outside /{path.parts[1]}")
    if not outer.exists():
        raise InputError(f"sandbox: {outer}, to be seen as {inner}, does not exist")


def _check_command(spec: BoxSpec) -> None:
    """No byte that ends a string in C: the list of bubblewrap's arguments is split at them."""
    words = (*spec.command, *spec.env, *spec.env.values(), *spec.readonly.values(), *map(str, spec.readonly))
    if not spec.command or not all(spec.command[:1]):
        raise InputError("sandbox: expected a command to run, found none")
    if any("\0" in word for word in words) or any("=" in name or not name for name in spec.env):
        raise InputError(f"sandbox: expected words without NUL and names without '=', found {words!r}")
