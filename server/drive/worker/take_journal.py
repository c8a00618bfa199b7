"""TakeJournal: every action of a take, appended to its file before the tick in which it takes effect.

JSON lines. Line 1 is the header. Line 2 + t holds the actions of tick t and `h`, the digest of the recording up to the
tick before, which guards every re-execution. A line is one write, so what a killed process leaves is whole lines and at
most one torn one. Lines that a branch shares with its parent are copied: each file stands alone.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mdrive_sumo.contract import DRIVER, Control, Note
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import open_appended, write_bytes
from mdrive_sumo.episode.recorder import DIGEST_BYTES
from mdrive_sumo.runs.takes import Action, DriverChoice
from server.drive.take_tree import DriverChange

JOURNAL_FORMAT = "mdrive-sumo/drive-actions/1"
MAX_JOURNAL_BYTES = 2**28
"""A tick of eight people has about 700 bytes, the longest episode 2400 ticks; texts come on top."""


@dataclass(frozen=True, slots=True)
class CavAction:
    """What happens in one CAV in one tick, and the number of the person's input."""

    action: Action
    number: int = 0
    """Of the input; 0: none."""


@dataclass(frozen=True, slots=True)
class TickActions:
    """What happens in all CAVs in one tick."""

    cavs: Mapping[str, CavAction] = field(default_factory=dict[str, CavAction])
    """By CAV; one without an entry goes on as before."""
    left: tuple[str, ...] = ()
    """The CAVs whose people leave in this tick."""
    digest: str = ""
    """Digest of the episode up to the tick before, hexadecimal; "" in tick 0."""


@dataclass(frozen=True, slots=True)
class JournalHeader:
    """Which take a journal belongs to, should its tree be older."""

    take: int
    parent: int | None
    tick: int
    """The first tick of its own."""
    entered_tick: int = 0
    """The actions of all ticks before are those of the run that the drive entered; 0: none."""


class TakeJournal:
    """The journal of one take, open for appending."""

    def __init__(self, path: Path) -> None:
        """Open a journal that `create` has made, behind its last whole line. Raises OSError."""
        self._path = path
        self._descriptor = open_appended(path)
        content = os.pread(self._descriptor, MAX_JOURNAL_BYTES, 0)
        self._end = content.rfind(b"\n") + 1

    @classmethod
    def create(cls, path: Path, header: JournalHeader, ticks: Sequence[TickActions]) -> "TakeJournal":
        """Write a new journal that begins with the given ticks, and open it. Raises OSError; no file is left then."""
        about = {"format": JOURNAL_FORMAT, **asdict(header)}
        text = "".join((_dump(about), *(_format_tick(tick, actions) for tick, actions in enumerate(ticks))))
        write_bytes(path, text.encode())
        return cls(path)

    def append(self, tick: int, actions: TickActions) -> None:
        """Append the actions of a tick. Raises OSError, e.g. for a full disk; nothing of the line is left then."""
        data = _format_tick(tick, actions).encode()
        try:
            _write_all(self._descriptor, data, self._end)
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            raise
        self._end += len(data)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


def _write_all(descriptor: int, data: bytes, offset: int) -> None:
    while data:
        written = os.pwrite(descriptor, data, offset)
        data, offset = data[written:], offset + written


def _dump(content: Mapping[str, Any]) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False) + "\n"


def _format_tick(tick: int, actions: TickActions) -> str:
    row: dict[str, Any] = {"t": tick}
    if actions.digest:
        row["h"] = actions.digest
    if actions.cavs:
        row["c"] = {cav: _format_cav(one) for cav, one in actions.cavs.items()}
    if actions.left:
        row["left"] = list(actions.left)
    return _dump(row)


def _format_cav(one: CavAction) -> dict[str, Any]:
    action, row = one.action, {}
    if action.driver is not None:
        row["d"] = json.loads(action.driver.to_note().text)
    if action.control is not None:
        row["u"] = [action.control.throttle, action.control.brake, action.control.steer]
    if one.number:
        row["n"] = one.number
    if action.texts:
        row["x"] = list(action.texts)
    return row


def list_driver_changes(ticks: Iterable[TickActions]) -> list[DriverChange]:
    """Return who drives from which tick on, as the actions of all ticks from 0 on say."""
    return [
        DriverChange(tick, cav, one.action.driver.name)
        for tick, actions in enumerate(ticks)
        for cav, one in actions.cavs.items()
        if one.action.driver is not None
    ]


def find_drivers(ticks: Iterable[TickActions], tick: int) -> dict[str, str]:
    """Return the driver of each CAV in a tick, as far as the actions of the ticks up to it say."""
    return {one.cav: one.driver for one in list_driver_changes(ticks) if one.tick <= tick}


def read_journal(path: Path) -> tuple[JournalHeader, list[TickActions]]:
    """Return the header and the actions of all ticks; a torn last line is left out.

    Raises InputError for a file that is missing, no journal, or damaged elsewhere.
    """
    first, *lines = _read_lines(path)
    header = _parse_header(path, first)
    return header, [_parse_tick(f"{path}: line {2 + tick}", tick, line) for tick, line in enumerate(lines)]


def summarize_journal(path: Path) -> tuple[JournalHeader, int]:
    """Return the header and the number of ticks, whose actions are not checked. Raises InputError as `read_journal`."""
    lines = _read_lines(path)
    return _parse_header(path, lines[0]), len(lines) - 1


def find_left_tick(path: Path) -> int | None:
    """Return the first tick in which people left the take; None: in no tick. Raises InputError as `read_journal`."""
    for tick, line in enumerate(_read_lines(path)[1:]):
        if b'"left":' in line and _parse_tick(f"{path}: line {2 + tick}", tick, line).left:
            return tick
    return None


def _read_lines(path: Path) -> list[bytes]:
    """Return the whole lines of a journal, of which there is one at least."""
    try:
        content = read_bytes(path, MAX_JOURNAL_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    lines = content[: content.rfind(b"\n") + 1].splitlines()
    if not lines:
        raise InputError(f"{path}: expected the actions of a take, found an empty file")
    return lines


def _parse_object(place: str, line: bytes) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        raise InputError(f"{place}: expected a JSON object, found {line[:60]!r}") from None
    if not isinstance(content, dict):
        raise InputError(f"{place}: expected a JSON object, found a {type(content).__name__}")
    return content


def _parse_header(path: Path, line: bytes) -> JournalHeader:
    content = _parse_object(f"{path}: line 1", line)
    if content.get("format") != JOURNAL_FORMAT:
        raise InputError(f"{path}: expected {JOURNAL_FORMAT}, found {content.get('format')!r:.60}")
    take, parent, tick, entered = (content.get(name) for name in ("take", "parent", "tick", "entered_tick"))
    if not all(type(value) is int and value >= 0 for value in (take, tick, entered, 0 if parent is None else parent)):
        raise InputError(f"{path}: line 1: expected whole numbers for take, parent, tick, found {line[:100]!r}")
    return JournalHeader(take, parent, tick, entered)  # pyright: ignore[reportArgumentType] - checked above


def _parse_tick(place: str, tick: int, line: bytes) -> TickActions:
    row = _parse_object(place, line)
    if row.get("t") != tick:
        raise InputError(f"{place}: expected tick {tick}, found {row.get('t')!r:.40}")
    digest, cavs, left = row.get("h", ""), row.get("c", {}), row.get("left", [])
    if not isinstance(digest, str) or len(digest) not in (0, 2 * DIGEST_BYTES):
        raise InputError(f"{place}: h: expected {2 * DIGEST_BYTES} hexadecimal digits, found {digest!r:.40}")
    if not isinstance(cavs, dict) or not isinstance(left, list) or not all(isinstance(cav, str) for cav in left):
        raise InputError(f"{place}: expected actions by CAV and a list of CAVs that are left, found {line[:100]!r}")
    return TickActions({cav: _parse_cav(f"{place}: {cav:.80}", one) for cav, one in cavs.items()}, tuple(left), digest)


def _parse_cav(place: str, row: object) -> CavAction:
    if not isinstance(row, dict):
        raise InputError(f"{place}: expected an object, found {row!r:.60}")
    control, number, texts = row.get("u"), row.get("n", 0), row.get("x", [])
    if type(number) is not int or not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise InputError(f"{place}: expected a number of an input and texts, found {row!r:.100}")
    if control is not None and not (isinstance(control, list) and len(control) == 3):
        raise InputError(f"{place}: u: expected throttle, brake and steer, found {control!r:.60}")
    try:
        driver = DriverChoice.from_note(Note(DRIVER, json.dumps(row["d"]))) if "d" in row else None
        return CavAction(Action(driver, Control(*control) if control is not None else None, tuple(texts)), number)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
