"""Paths inside an archive: relative, plain, and the same on every file system."""

from collections.abc import Iterable
from unicodedata import normalize

from server.archive.errors import ArchiveRefused

MAX_NAME_BYTES = 200
"""UTF-8; also less than the 255 that a file system allows for one part of a path."""


def check_names(names: Iterable[str], max_count: int) -> None:
    """Raise ArchiveRefused for paths that leave the folder, clash or are too many. Folders end in a slash."""
    listed: set[str] = set()
    folders: dict[str, bool] = {}
    spelled: dict[str, str] = {}
    for name in names:
        _check_name(name)
        path = name.removesuffix("/")
        if path in listed:
            raise ArchiveRefused(f"archive: expected every path once, found {path!r:.80} again")
        listed.add(path)
        for part, folder in (*((parent, True) for parent in _parents(path)), (path, name.endswith("/"))):
            if folders.setdefault(part, folder) != folder:
                raise ArchiveRefused(f"archive: {part!r:.80}: expected a file or a folder, found both")
            other = spelled.setdefault(normalize("NFC", part).casefold(), part)
            if other != part:
                raise ArchiveRefused(
                    f"archive: expected paths that differ in more than case, found {other!r:.80} and {part!r:.80}"
                )
        if len(folders) > max_count:
            raise ArchiveRefused(f"archive: expected at most {max_count} files and folders, found more")


def _check_name(name: str) -> None:
    """Check a single path."""
    shown = f"archive: entry {name!r:.80}: expected"
    if len(name.encode("utf-8", "surrogatepass")) > MAX_NAME_BYTES:
        raise ArchiveRefused(f"{shown} a path of at most {MAX_NAME_BYTES} bytes, found {len(name)} characters")
    if not name.isprintable():
        raise ArchiveRefused(f"{shown} printable characters, found others")
    if bad := [character for character in "\\:" if character in name]:
        raise ArchiveRefused(f"{shown} parts separated by '/', found {bad[0]!r}")
    parts = name.removesuffix("/").split("/")
    if name.startswith("/") or not {"", ".", ".."}.isdisjoint(parts):
        raise ArchiveRefused(f"{shown} a relative path without empty parts, '.' and '..', found another")


def _parents(path: str) -> list[str]:
    parts = path.split("/")
    return ["/".join(parts[:count]) for count in range(1, len(parts))]
