"""Reads zip files as untrusted input, on top of `zipfile`, which checks no limits, names and overlapping entries."""

import errno
import io
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from unicodedata import normalize
from zipfile import ZipFile, ZipInfo

from server.archive.layout import FREE_BYTES, ArchiveLimits, ArchiveRefused
from server.environments import MEBIBYTE

METHODS = {zipfile.ZIP_STORED: "stored", zipfile.ZIP_DEFLATED: "deflated"}
ENCRYPTED = 0x1 | 0x40 | 0x2000
"""Flags of an entry: encrypted, strongly encrypted, masked headers."""
LOCAL_HEADER = struct.Struct("<4s22xHH")
"""Signature, lengths of name and extra field."""
BYTES_PER_RECORD = 1024
"""Upper bound of an entry's record in the directory: fixed part, name, extra fields, comment."""
CHUNK = 1 << 16
"""Bytes that are unpacked at a time, so that no entry is in memory as a whole."""
BAD_ZIP = (zipfile.BadZipFile, zlib.error, struct.error, ValueError, NotImplementedError, EOFError, RuntimeError)
"""Exceptions of zipfile for damaged or manipulated files."""


class _BoundedFile(io.FileIO):
    """A file that limits the size of a single read, because zipfile reads the directory as a whole."""

    max_read = 0

    def read(self, size: int | None = -1, /) -> bytes:
        wanted = size if size is not None and size >= 0 else os.fstat(self.fileno()).st_size - self.tell()
        if wanted > self.max_read:
            raise ArchiveRefused("archive: expected fewer entries, found a directory that is too long")
        return super().read(size)


@contextmanager
def open_archive(path: Path, limits: ArchiveLimits) -> Generator[ZipFile]:
    """Open a zip file and check its entries. Raises ArchiveRefused, also for zip errors inside the block."""
    size = path.stat().st_size
    if not 0 < size <= limits.archive_bytes:
        found = f"{size} bytes" if size else "an empty file"
        raise ArchiveRefused(f"archive: expected a zip file of at most {limits.archive_bytes} bytes, found {found}")
    with translate_zip_errors(), _BoundedFile(path) as file:
        file.max_read = max(limits.entries * BYTES_PER_RECORD, 2 * CHUNK)
        with ZipFile(file) as archive:
            _check_entries(archive, file, limits)
            yield archive


@contextmanager
def translate_zip_errors() -> Generator[None]:
    """Raise ArchiveRefused for exceptions of zipfile."""
    try:
        yield
    except BAD_ZIP as error:
        raise _damaged_error(error) from None
    except OSError as error:
        if error.errno != errno.EINVAL:
            raise
        raise _damaged_error(error) from None  # a position before the beginning of the file


def _damaged_error(error: Exception) -> ArchiveRefused:
    text = " ".join(str(error).split())
    return ArchiveRefused(f"archive: expected a whole zip file, found a damaged one ({text:.120})")


def read_entry(archive: ZipFile, info: ZipInfo) -> Generator[bytes]:
    """Read an entry in chunks. Raises ArchiveRefused or one of `BAD_ZIP` unless size and checksum are as declared."""
    count = 0
    with archive.open(info) as stream:
        while piece := stream.read(CHUNK):
            count += len(piece)
            yield piece
    if count != info.file_size:
        raise ArchiveRefused(
            f"archive: {info.filename!r:.80}: expected {info.file_size} bytes as declared, found {count}"
        )


def _check_entries(archive: ZipFile, file: _BoundedFile, limits: ArchiveLimits) -> None:
    infos = archive.infolist()
    if not infos:
        raise ArchiveRefused("archive: expected files, found an empty archive")
    if len(infos) > limits.entries:
        raise ArchiveRefused(f"archive: expected at most {limits.entries} entries, found {len(infos)}")
    for info in infos:
        _check_entry(info, limits)
    check_names((info.filename for info in infos), limits.entries)
    total = sum(info.file_size for info in infos)
    if total > limits.unpacked_bytes:
        raise ArchiveRefused(f"archive: expected at most {limits.unpacked_bytes} bytes unpacked, found {total}")
    size = os.fstat(file.fileno()).st_size
    if total > max(FREE_BYTES, limits.total_ratio * size):
        raise ArchiveRefused(
            f"archive: expected to unpack to at most {limits.total_ratio} times its {size} bytes, found {total} bytes"
        )
    _check_no_overlap(file, infos, archive.start_dir)


def _check_entry(info: ZipInfo, limits: ArchiveLimits) -> None:
    shown = f"archive: entry {info.filename!r:.80}: expected"
    folder = info.filename.endswith("/")  # `is_dir` fails for an empty name
    kind = stat.S_IFMT(info.external_attr >> 16)
    if kind not in (0, stat.S_IFDIR if folder else stat.S_IFREG):
        raise ArchiveRefused(f"{shown} a file or a folder, found {KINDS.get(kind, 'another kind')}")
    if info.flag_bits & ENCRYPTED:
        raise ArchiveRefused(f"{shown} no encryption, found it")
    if info.compress_type not in METHODS:
        raise ArchiveRefused(f"{shown} {' or '.join(METHODS.values())} data, found method {info.compress_type}")
    if folder and info.file_size:
        raise ArchiveRefused(f"{shown} a folder without data, found {info.file_size} bytes")
    if info.file_size > max(MEBIBYTE, limits.ratio * info.compress_size):
        raise ArchiveRefused(f"{shown} to unpack to at most {limits.ratio} times its size, found more")
    if info.compress_size > info.file_size + info.file_size // 1000 + 64:
        raise ArchiveRefused(
            f"{shown} its size declared, found {info.compress_size} bytes for {info.file_size} unpacked"
        )


KINDS = {
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFDIR: "a folder named as a file",
    stat.S_IFREG: "a file named as a folder",
}


def _check_no_overlap(file: io.FileIO, infos: Sequence[ZipInfo], directory: int) -> None:
    """Refuse entries that share bytes: a small file could contain many large entries."""
    ends = 0
    for info in sorted(infos, key=lambda info: info.header_offset):
        if info.header_offset < ends:
            raise ArchiveRefused(f"archive: entry {info.filename!r:.80}: expected data of its own, found shared data")
        file.seek(info.header_offset)
        signature, name, extra = LOCAL_HEADER.unpack(file.read(LOCAL_HEADER.size))
        ends = info.header_offset + LOCAL_HEADER.size + name + extra + info.compress_size
        if signature != b"PK\3\4" or ends > directory:
            raise ArchiveRefused(f"archive: entry {info.filename!r:.80}: expected its data in the file, found none")


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
