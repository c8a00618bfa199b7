"""FileTree: a file or folder of the host that is copied for a box, read once in a process."""

import hashlib
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agent_process.sandbox.runtime_files import is_interpreter_prefix, is_unused

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


_TREES: dict[Path, tuple[tuple[int, ...], FileTree]] = {}
"""Trees of this process, with what identified their top: reading thousands of names for each box takes too long."""


def find_tree(source: Path, hidden: frozenset[Path]) -> FileTree:
    """Return the tree at a path, read once in a process as long as its top stays the same."""
    top = source.stat()
    identity = (top.st_dev, top.st_ino, top.st_ctime_ns, top.st_mtime_ns, hash(hidden))
    known = _TREES.get(source)
    if known is not None and known[0] == identity:
        return known[1]
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
    for relative, found in _walk(source, skip):
        row = (os.fsencode(relative), found.st_mode, found.st_size, found.st_mtime_ns)
        digest.update(repr(row).encode())
        size += found.st_size
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
    for relative, found in _walk(tree.source, tree.skip):
        _copy_entry(tree.source / relative, target / relative, found)


def _copy_entry(source: Path, target: Path, found: os.stat_result) -> None:
    """Sockets, pipes and devices are left out."""
    if stat.S_ISLNK(found.st_mode):
        target.symlink_to(source.readlink())
    elif stat.S_ISDIR(found.st_mode):
        target.mkdir(exist_ok=True)
        target.chmod(stat.S_IMODE(found.st_mode) & MODE | stat.S_IRWXU)
    elif stat.S_ISREG(found.st_mode):
        shutil.copyfile(source, target)
        _copy_attributes(found, target)


def _copy_attributes(found: os.stat_result, target: Path) -> None:
    """Times too: Python compares those of a source with its compiled file."""
    target.chmod(stat.S_IMODE(found.st_mode) & MODE)
    os.utime(target, ns=(found.st_atime_ns, found.st_mtime_ns))
