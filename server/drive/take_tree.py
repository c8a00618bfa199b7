"""TakeTree: the takes of a drive folder, each a branch of another one, in `tree.json`.

A drive folder holds `tree.json`, `takes/N/` (a run folder, once take N is finished) and `takes/N.actions.jsonl`, the
journal of its actions. The journals are the truth: what the tree says of a finished take can be read from its run.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum, auto
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_text

TREE_FILE = "tree.json"
TREE_FORMAT = "mdrive-sumo/drive/1"
TAKES_FOLDER = "takes"
MAX_TREE_BYTES = 2**27
"""A take has about 400 bytes."""
MAX_TAKES = 100_000
MAX_NUMBER = 2**31
MAX_TAKE = 2**30
"""Largest number of a take in a file: those that a drive adds still fit a frame (`protocol`), and can be read again."""
MAX_LOSSES_LENGTH = 200
"""Of what cost one CAV score, in words."""
MAX_NAME_LENGTH = 80
"""Of a CAV or a driver, as in requests (`messages.Name`)."""


MAX_DRIVER_CHANGES = 100_000
"""Of one take: more than journals can hold."""


class TakeStatus(StrEnum):
    """Where a take is between its start and its recording."""

    RUNNING = auto()
    """People drive it, or did so when the server ended."""
    LEFT = auto()
    """The people have left it; it is not finished yet."""
    FINISHED = auto()
    """It has ended and is stored."""
    VOID = auto()
    """It cannot be finished: its journal is damaged, or its re-execution differs."""


@dataclass(frozen=True, slots=True)
class DriverChange:
    """A CAV has another driver from a tick on."""

    tick: int
    cav: str
    driver: str
    """`human`, or an agent."""


@dataclass(frozen=True, slots=True)
class Take:
    """One drive of the scenario."""

    number: int
    parent: int | None = None
    """The take from which it branches; None: it begins in tick 0, or in the run that was entered."""
    tick: int = 0
    """The first tick of its own: everything before is the same as in its parent."""
    drivers: Mapping[str, str] = field(default_factory=dict[str, str])
    """Driver by CAV in that tick."""
    changes: tuple[DriverChange, ...] = ()
    """Who drove after them, in the order of ticks."""
    status: TakeStatus = TakeStatus.RUNNING
    left_tick: int | None = None
    """The tick in which the people left it; None: they drove it to its end, or still do."""
    end_tick: int | None = None
    """Its last tick, once it is finished."""
    score: float | None = None
    """Driving score, mean of the CAVs, 0 to 100, once it is finished."""
    ds: Mapping[str, float] = field(default_factory=dict[str, float])
    """Driving score by CAV, once it is finished."""
    losses: Mapping[str, str] = field(default_factory=dict[str, str])
    """What cost score, in words, by CAV; without those that lost nothing."""

    @property
    def last_drivers(self) -> dict[str, str]:
        """Who drove each CAV last."""
        return {**self.drivers, **{one.cav: one.driver for one in self.changes}}

    def with_changes(self, changes: Iterable[DriverChange]) -> "Take":
        """Return the take with these changes of drivers, as far as they are its own and change something."""
        drivers, kept = dict(self.drivers), list[DriverChange]()
        for one in changes:
            if one.tick >= self.tick and drivers.get(one.cav) != one.driver:
                drivers[one.cav] = one.driver
                kept.append(one)
        return replace(self, changes=tuple(kept))


@dataclass(frozen=True, slots=True)
class TakeTree:
    """All takes of a drive, by number, and what all of them have in common."""

    folder: Path
    about: Mapping[str, Any]
    """What is driven: `scenario`, `suite`, `seed` and the other settings that a continued drive must not change."""
    takes: Mapping[int, Take] = field(default_factory=dict[int, Take])

    @property
    def next_number(self) -> int:
        """The number of the next take."""
        return max(self.takes, default=0) + 1

    def find(self, number: int) -> Take:
        """Return a take. Raises InputError."""
        if number not in self.takes:
            count = f"1 to {max(self.takes)}" if self.takes else "none yet"
            raise InputError(f"take: expected one of this drive ({count}), found {number!r:.20}")
        return self.takes[number]

    def find_folder(self, number: int) -> Path:
        """Return the run folder of a take."""
        return self.folder / TAKES_FOLDER / str(number)

    def find_journal(self, number: int) -> Path:
        """Return the file with the actions of a take."""
        return self.folder / TAKES_FOLDER / f"{number}.actions.jsonl"

    def with_take(self, take: Take) -> "TakeTree":
        """Return the tree with a new or changed take."""
        return replace(self, takes={**self.takes, take.number: take})

    def without_take(self, number: int) -> "TakeTree":
        """Return the tree without a take that has no children."""
        return replace(self, takes={other: take for other, take in self.takes.items() if other != number})

    def list_line(self, number: int) -> Iterator[tuple[int, int | None]]:
        """Yield a take and its ancestors with the tick up to which each of them is part of the take; None: no limit."""
        limit: int | None = None
        current: int | None = number
        while current is not None:
            take = self.find(current)
            yield current, limit
            limit = take.tick if limit is None else min(limit, take.tick)
            current = take.parent

    def save(self) -> None:
        """Write the tree; an older file stays whole until the new one is. Raises OSError."""
        make_folder(self.folder / TAKES_FOLDER)
        takes = [asdict(take) for _, take in sorted(self.takes.items())]
        text = json.dumps({"format": TREE_FORMAT, "about": dict(self.about), "takes": takes}, indent=1)
        write_text(self.folder / TREE_FILE, text + "\n")


def has_tree(folder: Path) -> bool:
    """Return whether a folder holds a drive."""
    return (folder / TREE_FILE).exists()


def load_tree(folder: Path) -> TakeTree:
    """Return the tree of a drive folder. Raises InputError for a file that is no tree."""
    path = folder / TREE_FILE
    try:
        content = json.loads(read_bytes(path, MAX_TREE_BYTES))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, found none ({error})") from None
    if not isinstance(content, dict) or content.get("format") != TREE_FORMAT:
        found = content.get("format") if isinstance(content, dict) else type(content).__name__
        raise InputError(f"{path}: expected the takes of a drive ({TREE_FORMAT}), found {found!r:.60}")
    about, rows = content.get("about"), content.get("takes")
    if not isinstance(about, dict) or not isinstance(rows, list) or len(rows) > MAX_TAKES:
        raise InputError(f"{path}: expected an object `about` and a list `takes`, found something else")
    takes = [_parse_take(path, row) for row in rows]
    tree = TakeTree(folder, about, {take.number: take for take in takes})
    _check_tree(path, takes)
    return tree


def _parse_take(path: Path, row: object) -> Take:
    names = {one.name for one in fields(Take)}
    if not isinstance(row, dict) or not names >= set(row) or "number" not in row:
        raise InputError(f"{path}: takes: expected objects with {', '.join(sorted(names))}, found {row!r:.80}")
    place = f"{path}: take {row['number']!r:.20}"
    return Take(
        number=_read_number(place, row, "number"),
        parent=_read_optional(place, row, "parent"),
        tick=_read_number(place, row, "tick"),
        drivers=_read_mapping(place, row, "drivers", _is_name),
        changes=_read_changes(place, row),
        status=_read_status(place, row),
        left_tick=_read_optional(place, row, "left_tick"),
        end_tick=_read_optional(place, row, "end_tick"),
        score=_read_score(place, row),
        ds=_read_mapping(place, row, "ds", _is_score),
        losses=_read_mapping(place, row, "losses", _is_text),
    )


def _read_optional(place: str, row: Mapping[str, Any], name: str) -> int | None:
    return None if row.get(name) is None else _read_number(place, row, name)


def _read_number(place: str, row: Mapping[str, Any], name: str) -> int:
    value = row.get(name)
    if type(value) is not int or not 0 <= value <= MAX_NUMBER:
        raise InputError(f"{place}: {name}: expected a whole number of at least 0, found {value!r:.40}")
    return value


def _read_mapping(place: str, row: Mapping[str, Any], name: str, is_sound: Callable[[object], bool]) -> dict[str, Any]:
    """Return an object by CAV. It is sent to pages, so it holds nothing that JSON in UTF-8 cannot."""
    value = row.get(name, {})
    if not isinstance(value, dict) or not all(_is_name(cav) and is_sound(one) for cav, one in value.items()):
        raise InputError(f"{place}: {name}: expected an object of CAVs, found {value!r:.60}")
    return value


def _read_changes(place: str, row: Mapping[str, Any]) -> tuple[DriverChange, ...]:
    rows = row.get("changes", [])
    names = {one.name for one in fields(DriverChange)}
    if not isinstance(rows, list) or len(rows) > MAX_DRIVER_CHANGES:
        raise InputError(f"{place}: changes: expected a list of changes of drivers, found {rows!r:.60}")
    for one in rows:
        if not isinstance(one, dict) or set(one) != names or not (_is_name(one["cav"]) and _is_name(one["driver"])):
            raise InputError(f"{place}: changes: expected objects with tick, cav and driver, found {one!r:.60}")
    return tuple(
        DriverChange(_read_number(f"{place}: changes", one, "tick"), one["cav"], one["driver"]) for one in rows
    )


def _is_name(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MAX_NAME_LENGTH and value.isprintable()


def _is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= MAX_LOSSES_LENGTH and value.isprintable()


def _is_score(value: object) -> bool:
    return type(value) in (int, float) and 0 <= value <= 100  # pyright: ignore[reportOperatorIssue] - NaN fails too


def _read_status(place: str, row: Mapping[str, Any]) -> TakeStatus:
    value = row.get("status")
    if value not in tuple(TakeStatus):
        raise InputError(f"{place}: status: expected {', '.join(TakeStatus)}, found {value!r:.40}")
    return TakeStatus(value)


def _read_score(place: str, row: Mapping[str, Any]) -> float | None:
    value = row.get("score")
    if value is not None and not _is_score(value):
        raise InputError(f"{place}: score: expected a number from 0 to 100, found {value!r:.40}")
    return value


def _check_tree(path: Path, takes: Sequence[Take]) -> None:
    """Raise InputError unless every take has a number of its own, and a parent with a smaller one."""
    numbers: set[int] = set()
    for take in takes:
        if not 1 <= take.number <= MAX_TAKE or take.number in numbers:
            raise InputError(f"{path}: take {take.number}: expected numbers from 1 on, each once, in ascending order")
        if take.parent is not None and take.parent not in numbers:
            raise InputError(f"{path}: take {take.number}: parent: expected an earlier take, found {take.parent}")
        numbers.add(take.number)
