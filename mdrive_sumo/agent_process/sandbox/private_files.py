"""Files of a box's own: copies in memory, so that two boxes that live at the same time share no inode and no page.

A shared inode carries data between boxes even if it is read-only: its locks, the pages of it that are in memory, the
processes that wait on it (`futex`), the processor's cache. The copies belong to a *slot*, in which one box lives at a
time, and are made once for all boxes of the slot that show the same files. Nothing that a box can do changes them: its
mounts are read-only, and files of a tmpfs are always in memory, so a copy tells a later box nothing of an earlier one.
"""

import atexit
import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agent_process.sandbox import bubblewrap
from mdrive_sumo.agent_process.sandbox.box_spec import BoxSpec
from mdrive_sumo.agent_process.sandbox.runtime_files import is_interpreter_prefix, is_unused, list_runtime_paths
from mdrive_sumo.agent_process.sandbox.user_slots import take_slot
from mdrive_sumo.core.errors import InputError

MODE = 0o777
"""Permissions that a copy keeps; set-uid bits are not among them."""
Skip = Callable[[Path], bool]
"""Whether a path, relative to the top of the tree, is left out."""


@dataclass(frozen=True, slots=True)
class FileTree:
    """A file or folder of the host as a box shall have it."""

    source: Path
    skip: Skip
    key: str
    """Changes with every change of names, sizes, permissions and times in it."""
    size_bytes: int
    """Of all files together."""


_TREES: dict[Path, tuple[tuple[int, ...], FileTree]] = {}
"""Trees of this process, with what identified their top: reading thousands of names for each box takes too long."""


def find_tree(source: Path, hidden: frozenset[Path]) -> FileTree:
    """Return the tree at a path, read once in a process as long as its top stays the same."""
    top = source.stat()
    identity = (top.st_dev, top.st_ino, top.st_ctime_ns, top.st_mtime_ns, hash(hidden))
    read_before = _TREES.get(source)
    if read_before is not None and read_before[0] == identity:
        return read_before[1]
    interpreter = is_interpreter_prefix(source)

    def skip(relative: Path) -> bool:
        return (interpreter and is_unused(relative)) or (source / relative).parent.resolve() in hidden

    tree = _read_tree(source, skip if interpreter or hidden else _skip_nothing)
    _TREES[source] = identity, tree
    return tree


def _skip_nothing(_relative: Path) -> bool:
    return False


def _read_tree(source: Path, skip: Skip) -> FileTree:
    digest, size = hashlib.blake2b(str(source).encode(), digest_size=12), 0
    for relative, status in _walk(source, skip):
        row = (os.fsencode(relative), status.st_mode, status.st_size, status.st_mtime_ns)
        digest.update(repr(row).encode())
        size += status.st_size
    return FileTree(source, skip, digest.hexdigest(), size)


def _walk(source: Path, skip: Skip) -> Iterator[tuple[Path, os.stat_result]]:
    """Yield every path below the source, folders before their content; just "." for a single file."""
    if not source.is_dir():
        yield Path(), source.stat()
        return
    waiting = [Path()]
    while waiting:
        folder = waiting.pop()
        with os.scandir(source / folder) as entries:
            for entry in sorted(entries, key=lambda each: each.name):
                relative = folder / entry.name
                if skip(relative):
                    continue
                yield relative, entry.stat(follow_symlinks=False)
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(relative)


def copy_tree(tree: FileTree, target: Path) -> None:
    """Write a copy of the tree as `target`. Raises OSError."""
    if tree.source.is_dir():
        target.mkdir(exist_ok=True)
        _copy_attributes(tree.source.stat(), target)
    for relative, status in _walk(tree.source, tree.skip):
        _copy_entry(tree.source / relative, target / relative, status)


def _copy_entry(source: Path, target: Path, status: os.stat_result) -> None:
    """Sockets, pipes and devices are left out."""
    if stat.S_ISLNK(status.st_mode):
        target.symlink_to(source.readlink())
    elif stat.S_ISDIR(status.st_mode):
        target.mkdir(exist_ok=True)
        target.chmod(stat.S_IMODE(status.st_mode) & MODE | stat.S_IRWXU)
    elif stat.S_ISREG(status.st_mode):
        shutil.copyfile(source, target)
        _copy_attributes(status, target)


def _copy_attributes(status: os.stat_result, target: Path) -> None:
    """Times too: Python compares those of a source with its compiled file."""
    target.chmod(stat.S_IMODE(status.st_mode) & MODE)
    os.utime(target, ns=(status.st_atime_ns, status.st_mtime_ns))


MEMORY = Path("/dev/shm")
"""Default place of the copies: a tmpfs, which has no pages that could be absent."""
FOLDER = "mdrive-sumo-files"
KEPT_S = 600.0
"""A copy that no box has used for so long is removed when a box with other files takes the slot [s]."""
UNFINISHED = "."
"""First letter of the names of copies that are being made or removed."""
MEBIBYTE = 1024**2

_PROVIDED: set[tuple[Path, int]] = set()
"""Folders and slots in which this process made or used copies."""


def provide_private_files(spec: BoxSpec, slot: int) -> dict[str, Path]:
    """Return where the box sees which path of the host, like `bubblewrap.list_sources`, with copies of the slot's own.

    The slot must be taken by this process. Raises InputError if there is no room for the copies.
    """
    assert spec.copies is not None
    place = _make_place(spec.copies, slot)
    _PROVIDED.add((spec.copies, slot))
    seen = bubblewrap.list_sources(spec)
    shared = {inner: outer for inner, outer in seen.items() if outer.is_symlink() or inner in spec.live}
    system = {inner for inner in seen if spec.rootfs is None and inner not in spec.readonly.values()} - set(shared)
    hidden = frozenset(path.resolve() for path in spec.hidden)
    trees = {inner: find_tree(seen[inner], hidden) for inner in seen if inner not in shared and inner not in system}
    copies = _provide_trees(trees, place, seen)
    if system:
        root = _provide_system(spec, place)
        copies |= {inner: root / inner[1:] for inner in system if (root / inner[1:]).exists()}
    _remove_unused(place, {path.name for path in copies.values()} | {"system"})
    return shared | copies


def remove_idle_files(folder: Path, slots: Iterable[int] | None = None) -> None:
    """Remove this user's copies of these slots, or of all, unless a box lives in the slot."""
    if slots is None:
        names = [path.name for path in _name_place(folder, 0).parent.glob("*")]
        slots = [int(name) for name in names if name.isdigit()]
    for number in slots:
        with suppress(InputError):  # taken by a box
            slot = take_slot(number)
            try:
                _remove_place(_name_place(folder, number))
            finally:
                slot.release(clean=True)


@atexit.register
def _remove_own_files() -> None:
    """At the end of a process that opened boxes. What a killed one left is used, or removed, by the next."""
    for folder in {folder for folder, _ in _PROVIDED}:
        remove_idle_files(folder, {slot for provided, slot in _PROVIDED if provided == folder})


def find_file_system(folder: Path) -> str:
    """Return the kind of file system that a folder lies on, such as "tmpfs"."""
    rows = (line.split(" - ") for line in Path("/proc/self/mountinfo").read_text().splitlines())
    kinds = {left.split()[4]: right.split()[0] for left, right in rows}  # of two mounts at one place, the last counts
    path = folder.resolve()
    return next((kinds[str(each)] for each in (path, *path.parents) if str(each) in kinds), "an unknown file system")


def _name_place(folder: Path, slot: int) -> Path:
    return folder / f"{FOLDER}-{os.geteuid()}" / str(slot)


def _make_place(folder: Path, slot: int) -> Path:
    place = _name_place(folder, slot)
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        owner, flags = place.parent.stat().st_uid, os.statvfs(place).f_flag
    except OSError as error:
        raise InputError(f"sandbox: {folder}, for the files of boxes: {error.strerror}") from error
    if owner != os.geteuid():
        raise InputError(f"sandbox: expected {place.parent} to belong to user {os.geteuid()}, found user {owner}")
    if flags & os.ST_NOEXEC:
        raise InputError(
            f"sandbox: expected a folder for the files of boxes from which programs can be run, found {folder} mounted"
            " with noexec; name another one ([sandbox] copies)"
        )
    return place


def _provide(tree: FileTree, place: Path) -> Path:
    """Return the slot's copy of a tree; makes it unless it is there."""
    copy = place / tree.key
    if not copy.exists():
        _fill(copy, tree.size_bytes, lambda target: copy_tree(tree, target))
    os.utime(copy)
    return copy


def _provide_trees(trees: Mapping[str, FileTree], place: Path, seen: Iterable[str]) -> dict[str, Path]:
    """Return where the slot's copies are, by path in the box. Trees in one folder of the box are copied as that folder.

    A mount less for each: bubblewrap reads the list of all mounts after each one, which took 10 ms of a box's start.
    seen: all paths that the box sees; nothing else can be mounted in a folder that is one read-only mount.
    """
    by_folder: dict[str, dict[str, FileTree]] = {}
    for inner, tree in trees.items():
        folder, _, name = inner.rpartition("/")
        by_folder.setdefault(folder, {})[name] = tree
    copies: dict[str, Path] = {}
    for folder, members in by_folder.items():
        inside = {inner for inner in seen if inner.startswith(f"{folder}/")}
        if folder and len(members) > 1 and inside == {f"{folder}/{name}" for name in members}:
            copies[folder] = _provide_folder(members, place)
        else:
            copies |= {f"{folder}/{name}": _provide(tree, place) for name, tree in members.items()}
    return copies


def _provide_folder(members: Mapping[str, FileTree], place: Path) -> Path:
    """Return the slot's copy of a folder with these trees under these names; makes it unless it is there."""
    rows = sorted((name, tree.key) for name, tree in members.items())
    copy = place / hashlib.blake2b(repr(rows).encode(), digest_size=12).hexdigest()
    if not copy.exists():
        _fill(copy, sum(tree.size_bytes for tree in members.values()), lambda target: _copy_folder(members, target))
    os.utime(copy)
    return copy


def _copy_folder(members: Mapping[str, FileTree], target: Path) -> None:
    target.mkdir()
    target.chmod(0o755)
    for name, tree in members.items():
        copy_tree(tree, target / name)


def _provide_system(spec: BoxSpec, place: Path) -> Path:
    """Return the slot's copy of the host's programs that this box needs; its name tells for which interpreter."""
    paths = list_runtime_paths(_locate_program(spec))
    stamp = [(str(path), path.lstat().st_size, path.lstat().st_mtime_ns) for path in paths]
    key = hashlib.blake2b(repr(stamp).encode(), digest_size=12).hexdigest()
    copy = place / f"system-{key}"
    if not copy.exists():
        trees = {path: find_tree(path, frozenset()) for path in paths if not path.is_symlink()}
        size = sum(tree.size_bytes for tree in trees.values())
        _fill(copy, size, lambda target: _copy_system(paths, trees, target))
    os.utime(copy)
    return copy


def _locate_program(spec: BoxSpec) -> str:
    """Return the host's path of the program that the box runs."""
    word = spec.command[0]
    for outer, inner in spec.readonly.items():
        if word.startswith(inner + "/"):
            return str(outer.resolve() / word[len(inner) + 1 :])
    return word


def _copy_system(paths: tuple[Path, ...], trees: Mapping[Path, FileTree], target: Path) -> None:
    target.mkdir()
    for path in paths:
        inside = target / path.relative_to("/")
        inside.parent.mkdir(parents=True, exist_ok=True)
        if path.is_symlink():
            inside.symlink_to(path.readlink())
        else:
            copy_tree(trees[path], inside)


def _fill(copy: Path, size_bytes: int, write: Callable[[Path], None]) -> None:
    """Write beside the copy first: one that exists is complete. Raises InputError."""
    free = shutil.disk_usage(copy.parent).free
    if free < size_bytes:
        raise InputError(
            f"sandbox: expected {-(-size_bytes // MEBIBYTE)} MiB free in {copy.parents[2]} for the files of a box,"
            f" found {free // MEBIBYTE} MiB; make it larger or name another folder ([sandbox] copies)"
        )
    with tempfile.TemporaryDirectory(prefix=f"{UNFINISHED}new-", dir=copy.parent) as made:
        try:
            write(Path(made) / "copy")
            (Path(made) / "copy").rename(copy)
        except OSError as error:
            raise InputError(f"sandbox: the files of a box cannot be copied: {error}") from error


def _remove_unused(place: Path, used: set[str]) -> None:
    """Remove copies that no box has used for a while, and what a killed process left half made or half removed."""
    for path in place.iterdir():
        with suppress(OSError):
            abandoned = path.name.startswith(UNFINISHED)
            if abandoned or (path.name not in used and path.stat().st_mtime < time.time() - KEPT_S):
                _remove_copy(path)


def _remove_place(place: Path) -> None:
    with suppress(OSError):
        for path in sorted(place.iterdir()):  # what is unfinished first: its names are needed
            _remove_copy(path)
        place.rmdir()


def _remove_copy(path: Path) -> None:
    """Take its name away first: this process may be killed meanwhile, and a copy that has its name must be complete."""
    if not path.name.startswith(UNFINISHED):
        path = path.rename(path.with_name(f"{UNFINISHED}old-{path.name}"))
    shutil.rmtree(path) if path.is_dir() else path.unlink()
