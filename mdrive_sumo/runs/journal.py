"""The journal of a run: JSON lines that are only appended, so an interrupted run loses no finished episode.

Line 1 is the header: format and fingerprint, i.e. everything that makes two runs the same run, and `about`, which says
what the run is: its description in results and its number of episodes. Every other line is `{"result": {...},
"recording": "sha256:..."}`, a finished scenario, or `{"failed": {"scenario", "reason"}}`, a try without one. Each line
ends with a `checksum` of itself and of all lines before it, so that a line that was changed, inserted or removed is
found. It protects against accidents and edits by hand; `verify` against forgery.
"""

import json
import os
import re
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import blake2b
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import check_tree, read_bytes
from mdrive_sumo.core.output_files import make_parents, open_appended
from mdrive_sumo.core.posix import import_posix, is_posix
from mdrive_sumo.scoring import EpisodeKey

if TYPE_CHECKING:
    import fcntl
else:
    fcntl = import_posix("fcntl")

FORMAT = "mdrive-sumo/journal/2"
JOURNAL_FILE = "journal.jsonl"

Fingerprint = Mapping[str, str | int | bool]
MAX_JOURNAL_BYTES = 2**30
"""The longest journals, of all scenarios with 20 seeds, have 60 MB."""
_CHECKSUM = re.compile(rb',"checksum":"([0-9a-f]{16})"\}\n\Z')
_CHECKSUM_BYTES = 8
"""Enough against accidents: one damaged line in 2**64 is taken for a sound one."""


@dataclass(frozen=True, slots=True)
class JournalText:
    """What can be read of a journal."""

    lines: tuple[dict[str, Any], ...]
    """The complete lines."""
    checksum: str
    """Of the last of them; "" if there is none."""
    good_bytes: int
    """Length of the complete lines."""
    torn: bool
    """Whether an incomplete line follows them."""

    @property
    def about(self) -> Mapping[str, Any]:
        """What the header says of the run beside its fingerprint."""
        about = self.lines[0].get("about") if self.lines else None
        return about if isinstance(about, dict) else {}

    @property
    def results(self) -> tuple[dict[str, Any], ...]:
        """The finished scenarios, oldest first."""
        return tuple(line["result"] for line in self.lines[1:] if "result" in line)

    @property
    def recordings(self) -> dict[EpisodeKey, str]:
        """Checksum of the last recording by scenario and seed, as far as the journal notes them."""
        noted = (line for line in self.lines[1:] if "recording" in line)
        return {find_entry_key(line["result"]): line["recording"] for line in noted}


def find_entry_key(entry: Mapping[str, Any]) -> EpisodeKey:
    """Return scenario and seed of a result in a journal; a result without a readable seed has 0."""
    seed = entry.get("seed")
    return str(entry.get("id")), seed if isinstance(seed, int) else 0


@dataclass
class Journal:
    """An open, locked journal."""

    path: Path
    descriptor: int
    found: JournalText
    """What earlier starts of the same run have written; its incomplete last line has been dropped."""
    _checksum: str = field(init=False)

    def __post_init__(self) -> None:
        self._checksum = self.found.checksum

    @property
    def results(self) -> tuple[dict[str, Any], ...]:
        """The finished scenarios of earlier starts, oldest first."""
        return self.found.results

    @property
    def torn(self) -> bool:
        """Whether the last line was incomplete (power cut, full disk) and has been dropped."""
        return self.found.torn

    def add_result(self, result: Mapping[str, Any], recording: str = "") -> None:
        """Append a finished scenario and the checksum of its recording; it is on the disk when this returns."""
        self._append({"result": result} | ({"recording": recording} if recording else {}))

    def add_failure(self, scenario: str, reason: str) -> None:
        """Append the reason why a try had no result."""
        self._append({"failed": {"scenario": scenario, "reason": reason}})

    def add_header(self, fingerprint: Fingerprint, about: Mapping[str, Any]) -> None:
        """Append the first line."""
        self._append({"format": FORMAT, "fingerprint": dict(fingerprint)} | ({"about": about} if about else {}))

    def _append(self, line: Mapping[str, Any]) -> None:
        body = json.dumps(line, separators=(",", ":"), allow_nan=False).encode()
        self._checksum = _compute_checksum(self._checksum, body)
        _write(self.path, self.descriptor, body[:-1] + f',"checksum":"{self._checksum}"}}\n'.encode())


@contextmanager
def open_journal(
    folder: Path, fingerprint: Fingerprint, *, fresh: bool, about: Mapping[str, Any] | None = None
) -> Generator[Journal]:
    """Open the journal of a run folder, new or continued; it is locked until the block ends. Raises InputError.

    fresh: drop the content of an earlier run. about: what a new journal says of the run beside its fingerprint.
    """
    path = folder / JOURNAL_FILE
    if folder.is_dir():
        check_tree(folder)  # what is written below it stays there
    descriptor = _open(path)
    try:
        _lock(path, descriptor)
        if fresh:
            os.ftruncate(descriptor, 0)
        content = _read(path)
        if _is_unused(path, content, fingerprint):
            os.ftruncate(descriptor, 0)
            content = _read(path)
        if content.lines:
            _check_header(path, content.lines[0], fingerprint)
        os.ftruncate(descriptor, content.good_bytes)
        os.lseek(descriptor, 0, os.SEEK_END)
        journal = Journal(path, descriptor, content)
        if not content.lines:
            journal.add_header(fingerprint, about or {})
        yield journal
    finally:
        os.close(descriptor)


def _is_unused(path: Path, content: JournalText, fingerprint: Fingerprint) -> bool:
    """Return whether the journal is that of another command for which nothing was done, such as a refused agent."""
    return len(content.lines) == 1 and _read_header_fingerprint(path, content.lines[0]) != fingerprint


def _open(path: Path) -> int:
    try:
        make_parents(path)
        return open_appended(path)
    except OSError as error:
        raise InputError(f"{path.parent}: cannot be written: {error.strerror}") from None


def _lock(path: Path, descriptor: int) -> None:
    """Lock a journal; on Windows, which has no such locks, two runs in one folder are the user's affair."""
    if not is_posix():
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{path.parent}: expected a free run folder, found another process at work in it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be locked: {error.strerror}") from None


def _write(path: Path, descriptor: int, data: bytes) -> None:
    try:
        while data:  # one write, but a disk that fills up takes a part of it first
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def read_journal(path: Path) -> JournalText:
    """Return the content of a journal file. Raises InputError for a corrupt line or a checksum that does not fit.

    An incomplete last line is what an interrupted write leaves, and no error. Raises OSError.
    """
    raw = read_bytes(path, MAX_JOURNAL_BYTES)
    lines: list[dict[str, Any]] = []
    checksum, good_bytes = "", 0
    for number, text in enumerate(raw.splitlines(keepends=True), start=1):
        line = _parse_line(text)
        if line is None:
            if text.endswith(b"\n"):  # a write that was cut off has no end of line
                raise InputError(f"{path}: line {number}: expected a JSON object, found none; --fresh starts anew")
            return JournalText(tuple(lines), checksum, good_bytes, True)
        checksum = _check_line(f"{path}: line {number}", text, checksum)
        line.pop("checksum")
        if "result" in line and not (isinstance(line["result"], dict) and "id" in line["result"]):
            raise InputError(f"{path}: line {number}: expected a result with an id, found none; --fresh starts anew")
        lines.append(line)
        good_bytes += len(text)
    return JournalText(tuple(lines), checksum, good_bytes, False)


def _parse_line(text: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return line if isinstance(line, dict) and text.endswith(b"\n") else None


def _check_line(place: str, text: bytes, before: str) -> str:
    """Return the checksum of a line. Raises InputError if it does not fit the line and the lines before."""
    noted = _CHECKSUM.search(text)
    if noted is None:
        raise InputError(f"{place}: expected a checksum at its end, found none; --fresh starts anew")
    expected = _compute_checksum(before, text[: noted.start()] + b"}")
    if (found := noted[1].decode()) != expected:
        raise InputError(
            f"{place}: expected the checksum {expected}, found {found}: this line or one before it was changed or"
            " damaged; --fresh starts anew"
        )
    return expected


def _compute_checksum(before: str, body: bytes) -> str:
    return blake2b(before.encode() + body, digest_size=_CHECKSUM_BYTES).hexdigest()


def _check_header(path: Path, header: Mapping[str, Any], fingerprint: Fingerprint) -> None:
    before = _read_header_fingerprint(path, header)
    differing = sorted(key for key in {*before, *fingerprint} if before.get(key) != fingerprint.get(key))
    if differing:
        what = ", ".join(describe_change(key, before.get(key), fingerprint.get(key)) for key in differing)
        raise InputError(
            f"{path.parent}: expected a run of this command, found one with another {what};"
            " --fresh starts anew, --out names another folder"
        )


def _read_header_fingerprint(path: Path, header: Mapping[str, Any]) -> dict[str, Any]:
    if header.get("format") != FORMAT or not isinstance(header.get("fingerprint"), dict):
        raise InputError(f"{path}: expected the format {FORMAT}, found {header.get('format')!r}")
    return header["fingerprint"]


def read_fingerprint(folder: Path) -> dict[str, Any]:
    """Return the fingerprint of a run folder, also while the run is going on. Raises InputError."""
    return read_run_journal(folder)[0]


def _read(path: Path) -> JournalText:
    """As `read_journal`. Raises InputError for every trouble."""
    try:
        return read_journal(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def read_run_journal(folder: Path) -> tuple[dict[str, Any], JournalText]:
    """Return the fingerprint of a run folder and its journal, also while the run is going on. Raises InputError."""
    path = folder / JOURNAL_FILE
    content = _read(path)
    if not content.lines:
        raise InputError(f"{path}: expected a journal, found an empty file")
    return _read_header_fingerprint(path, content.lines[0]), content


MAX_CHANGES = 4
"""Changed settings of a channel or an agent that a message names."""


def describe_change(key: str, before: object, now: object) -> str:
    """Return "seed 0 (now 1)"; of settings that are a JSON object, such as the channel's, what differs in them."""
    settings, new_settings = _parse_settings(before), _parse_settings(now)
    if settings is not None and new_settings is not None:
        names = [name for name in sorted({*settings, *new_settings}) if settings.get(name) != new_settings.get(name)]
        changes = [f"{name} {_shorten(settings.get(name))} (now {_shorten(new_settings.get(name))})" for name in names]
        left_out = f" and {len(changes) - MAX_CHANGES} more" if len(changes) > MAX_CHANGES else ""
        return f"{key}: {', '.join(changes[:MAX_CHANGES])}{left_out}"
    old, new = _shorten(before), _shorten(now)
    if old == new:  # long texts that begin alike
        alike = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(str(before), str(now), strict=False)))
        old, new = (f"...{_shorten(str(value)[max(0, alike - 4) :])}" for value in (before, now))
    return f"{key} {old} (now {new})"


def _parse_settings(value: object) -> dict[str, Any] | None:
    """Return the settings that a value of a fingerprint holds as JSON; None for other values."""
    if not isinstance(value, str) or not value.startswith("{"):
        return None
    try:
        settings = json.loads(value)
    except (ValueError, RecursionError):
        return None
    return settings if isinstance(settings, dict) else None


def _shorten(value: object) -> str:
    text = "none" if value is None else str(value).removeprefix("sha256:")
    return text if len(text) <= 24 else text[:12] + "..."
