"""The journal of a run: JSON lines that are only appended, so an interrupted run loses no finished episode.

Line 1 is the header: format and fingerprint, i.e. everything that makes two runs the same run. Every other
line is `{"result": {...}}`, a finished scenario, or `{"failed": {"scenario", "reason"}}`, a try without one.
"""

import fcntl
import json
import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError

FORMAT = "mdrive-sumo/journal/1"
JOURNAL_FILE = "journal.jsonl"

Fingerprint = Mapping[str, str | int | bool]


class Journal:
    """An open, locked journal. `results`: what earlier starts of the same run have written, oldest first."""

    def __init__(self, path: Path, descriptor: int, results: tuple[dict[str, Any], ...], torn: bool) -> None:
        self._path, self._descriptor = path, descriptor
        self.results = results
        self.torn = torn
        """Whether the last line was incomplete (power cut, full disk) and has been dropped."""

    def add_result(self, result: Mapping[str, Any]) -> None:
        """Append a finished scenario; it is on the disk when this returns."""
        _append(self._path, self._descriptor, {"result": result})

    def add_failure(self, scenario: str, reason: str) -> None:
        """Append the reason why a try had no result."""
        _append(self._path, self._descriptor, {"failed": {"scenario": scenario, "reason": reason}})


@contextmanager
def open_journal(folder: Path, fingerprint: Fingerprint, *, fresh: bool) -> Generator[Journal]:
    """Open the journal of a run folder, new or continued; it is locked until the block ends. Raises InputError.

    fresh: drop the content of an earlier run.
    """
    path = folder / JOURNAL_FILE
    descriptor = _open(path)
    try:
        _lock(path, descriptor)
        if fresh:
            os.ftruncate(descriptor, 0)
        lines, good_bytes, torn = _read(path)
        os.ftruncate(descriptor, good_bytes)
        os.lseek(descriptor, 0, os.SEEK_END)
        if lines:
            _check_header(path, lines[0], fingerprint)
        else:
            _append(path, descriptor, {"format": FORMAT, "fingerprint": dict(fingerprint)})
        results = tuple(line["result"] for line in lines[1:] if "result" in line)
        yield Journal(path, descriptor, results, torn)
    finally:
        os.close(descriptor)


def _open(path: Path) -> int:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise InputError(f"{path.parent}: cannot be written: {error.strerror}") from None


def _lock(path: Path, descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{path.parent}: expected a free run folder, found another process at work in it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be locked: {error.strerror}") from None


def _append(path: Path, descriptor: int, line: Mapping[str, Any]) -> None:
    data = json.dumps(line, separators=(",", ":"), allow_nan=False).encode() + b"\n"
    try:
        while data:  # one write, but a disk that fills up takes a part of it first
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _read(path: Path) -> tuple[list[dict[str, Any]], int, bool]:
    """Return the complete lines, their length in bytes, and whether an incomplete line follows them."""
    raw = path.read_bytes()
    lines: list[dict[str, Any]] = []
    good_bytes = 0
    for number, text in enumerate(raw.splitlines(keepends=True), start=1):
        line = _parse_line(text)
        if line is None:
            if good_bytes + len(text) < len(raw):
                raise InputError(f"{path}: line {number}: expected a JSON object, found none (--fresh starts anew)")
            return lines, good_bytes, True
        lines.append(line)
        good_bytes += len(text)
    return lines, good_bytes, False


def _parse_line(text: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(text)
    except ValueError:
        return None
    return line if isinstance(line, dict) and text.endswith(b"\n") else None


def _check_header(path: Path, header: Mapping[str, Any], fingerprint: Fingerprint) -> None:
    before = _read_header_fingerprint(path, header)
    differing = sorted(key for key in {*before, *fingerprint} if before.get(key) != fingerprint.get(key))
    if differing:
        what = ", ".join(
            f"{key} {_shorten(before.get(key))} (now {_shorten(fingerprint.get(key))})" for key in differing
        )
        raise InputError(
            f"{path.parent}: expected a run of this command, found one with another {what};"
            " --fresh starts anew, --out names another folder"
        )


def _read_header_fingerprint(path: Path, header: Mapping[str, Any]) -> dict[str, Any]:
    if header.get("format") != FORMAT or not isinstance(header.get("fingerprint"), dict):
        raise InputError(f"{path}: expected the format {FORMAT}, found {header.get('format')!r}")
    return header["fingerprint"]


def _shorten(value: object) -> str:
    text = str(value).removeprefix("sha256:")
    return text if len(text) <= 24 else text[:12] + "..."


def read_fingerprint(folder: Path) -> dict[str, Any]:
    """Return the fingerprint of a run folder, also while the run is going on. Raises InputError."""
    path = folder / JOURNAL_FILE
    try:
        lines, _, _ = _read(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if not lines:
        raise InputError(f"{path}: expected a journal, found an empty file")
    return _read_header_fingerprint(path, lines[0])
