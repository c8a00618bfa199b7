"""Compare two JSON values and name every place at which they differ."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mdrive_sumo.core.clean_text import truncate

ABSENT = "nothing"
"""What is found at a place that one of the two values does not have."""
MAX_CHARACTERS = 60
"""Length of a value in a sentence."""


@dataclass(frozen=True, slots=True)
class TreeDifference:
    """One place at which two JSON values differ, e.g. `scenarios[3].egos[0].ds`."""

    place: str
    expected: str
    found: str

    def __str__(self) -> str:
        return f"{self.place}: expected {self.expected}, found {self.found}"


def find_tree_differences(
    expected: Any, found: Any, place: str = "", tolerance: float = 0.0
) -> Iterator[TreeDifference]:
    """Yield every leaf that differs, in the order of `expected`.

    tolerance: how far two numbers may lie apart. Entries of lists that have an `id` are named by it.
    """
    if isinstance(expected, Mapping) and isinstance(found, Mapping):
        yield from _compare_mappings(expected, found, place, tolerance)
    elif isinstance(expected, list | tuple) and isinstance(found, list | tuple):
        yield from _compare_sequences(expected, found, place, tolerance)
    elif not _is_equal(expected, found, tolerance):
        yield TreeDifference(place, format_leaf(expected), format_leaf(found))


def format_leaf(value: object) -> str:
    """Return a value as a sentence shows it, shortened."""
    text = str(value) if isinstance(value, bool | int | float) or value is None else repr(value)
    return truncate(text, MAX_CHARACTERS)


def _compare_mappings(
    expected: Mapping[str, Any], found: Mapping[str, Any], place: str, tolerance: float
) -> Iterator[TreeDifference]:
    for name in (*expected, *(name for name in found if name not in expected)):
        inner = f"{place}.{name}" if place else str(name)
        if name not in found:
            yield TreeDifference(inner, format_leaf(expected[name]), ABSENT)
        elif name not in expected:
            yield TreeDifference(inner, ABSENT, format_leaf(found[name]))
        else:
            yield from find_tree_differences(expected[name], found[name], inner, tolerance)


def _compare_sequences(
    expected: Sequence[Any], found: Sequence[Any], place: str, tolerance: float
) -> Iterator[TreeDifference]:
    for i, (one, other) in enumerate(zip(expected, found, strict=False)):
        yield from find_tree_differences(one, other, f"{place}[{_name_entry(one, i)}]", tolerance)
    if len(expected) != len(found):
        yield TreeDifference(place, f"{len(expected)} entries", str(len(found)))


def _name_entry(entry: Any, index: int) -> str:
    return str(entry["id"]) if isinstance(entry, Mapping) and "id" in entry else str(index)


def _is_equal(expected: object, found: object, tolerance: float) -> bool:
    if isinstance(expected, bool) or isinstance(found, bool):
        return expected is found
    if isinstance(expected, int | float) and isinstance(found, int | float):
        return abs(expected - found) <= tolerance
    return type(expected) is type(found) and expected == found
