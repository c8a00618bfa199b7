"""Compare compiled functions with the Python text that says what they compute."""

import ctypes
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core import compiled
from mdrive_sumo.core.compiled.sources import list_sources

REFUSALS = (ValueError, ArithmeticError)
"""What a function raises for numbers that it cannot use; which of them may differ between twins."""
SAID_OF_WRONG_ARGUMENTS = *REFUSALS, TypeError, AttributeError, LookupError, SystemError, MemoryError, Warning
ODD = None, "text", float("nan"), -1, 10**30, [], (), {}, np.zeros(0), np.zeros((2, 3)), np.array(1.0)
COMPARED: Counter[tuple[str, bool]] = Counter()
"""How often a function was compared in this process where it returned, and where it refused its arguments."""


def compare_twins(name: str, *arguments: Any) -> Any:
    """Return what both functions of that name (as in `compiled.REFERENCES`) return; the bits must be equal.

    The compiled one must leave no memory and no reference behind; that is looked at for the first, second, fourth,
    eighth ... of the calls that return and of those that are refused. After the first it also gets arguments of other
    types and shapes, of which it may say anything but must not crash.
    """
    expected = call(get_reference(name), *arguments)
    found = call(get_compiled(name), *arguments)
    assert describe(found) == describe(expected), name
    kind = name, found is REFUSALS
    COMPARED[kind] += 1
    if COMPARED[kind].bit_count() == 1:
        check_memory(get_compiled(name), *arguments)
    if COMPARED[kind] == 1:
        for changed in change_arguments(arguments):
            call_anyhow(get_compiled(name), *changed)
    return found


def change_arguments(arguments: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
    """Return arguments of which one is of another type or shape, or has a part that is."""
    for i, argument in enumerate(arguments):
        for changed in (*ODD, *change_value(argument)):
            yield (*arguments[:i], changed, *arguments[i + 1 :])


def change_value(value: Any) -> Iterator[Any]:
    """Return values of the same type with other parts."""
    if isinstance(value, np.ndarray) and value.ndim:
        yield from (value[:-1], value.T, value[::2], value[None], np.concatenate((value, value)))
    elif type(value) in (tuple, list) and value:
        yield from (value[:-1], value + value, *(type(value)((odd, *value[1:])) for odd in ODD))
    elif isinstance(value, dict) and value:
        first = next(iter(value))
        yield from ({**value, first: odd} for odd in ODD)
        yield {key: part for key, part in value.items() if key is not first}
    elif is_dataclass(value) and not isinstance(value, type):
        values = {field.name: getattr(value, field.name) for field in fields(value)}
        for name, part in values.items():
            shorter = [part[:-1]] if isinstance(part, np.ndarray | tuple | list) and len(part) else []
            yield from (make_instance(type(value), {**values, name: odd}) for odd in (*ODD, *shorter))
        yield make_instance(type(value), {})


def make_instance(cls: type, values: dict[str, Any]) -> Any:
    """Return an instance of a dataclass that nothing has checked."""
    instance = object.__new__(cls)
    for name, value in values.items():
        object.__setattr__(instance, name, value)
    return instance


def call_anyhow(function: Callable[..., Any], *arguments: Any) -> None:
    """Call a function whose arguments may be wrong in any way."""
    with np.errstate(all="ignore"), suppress(*SAID_OF_WRONG_ARGUMENTS):
        function(*arguments)


def check_memory(function: Callable[..., Any], *arguments: Any) -> None:
    """Assert that calls keep no memory, no references to arguments, and give back none that is not theirs.

    What a few calls leave is looked at again after many: Python keeps up to 2000 tuples of a length for later, and
    NumPy has such stores too.
    """
    parts = list(list_parts(arguments))
    for calls in (20, 2500):
        call_anyhow(function, *arguments)
        before = measure_memory(parts)
        for _ in range(calls):
            call_anyhow(function, *arguments)
        grown = [count - was for count, was in zip(measure_memory(parts), before, strict=True)]
        if max(grown) < calls and min(grown[2:], default=0) > -calls:
            return
    raise AssertionError(f"{function.__name__}: {calls} calls with {arguments} add {grown} blocks, pieces, references")


def measure_memory(parts: list[Any]) -> list[int]:
    """Return counts of Python's blocks, of the C library's pieces, at most, and of references to each of the parts."""
    return [sys.getallocatedblocks(), _count_allocated_bytes() // LEAST_ALLOCATION, *map(sys.getrefcount, parts)]


LEAST_ALLOCATION = 16
"""Half of the bytes that the GNU C library takes for the smallest piece of memory."""


def list_parts(value: Any) -> Iterator[Any]:
    """Return a value and what it consists of."""
    yield value
    if is_dataclass(value) and not isinstance(value, type):
        value = [getattr(value, field.name, None) for field in fields(value)]
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, tuple | list):
        for part in value:
            yield from list_parts(part)


class _MallocInfo(ctypes.Structure):
    """What `mallinfo2` of the GNU C library returns (malloc.h): ten numbers."""

    _fields_ = (("numbers", ctypes.c_size_t * 10),)


_C_LIBRARY = ctypes.CDLL(None)
_C_LIBRARY.mallinfo2.restype = _MallocInfo


def _count_allocated_bytes() -> int:
    numbers = _C_LIBRARY.mallinfo2().numbers
    return numbers[4] + numbers[7]  # hblkhd, of large pieces, and uordblks, of all others


def get_reference(name: str) -> Callable[..., Any]:
    """Return the Python text of that name, whether or not its module has been imported."""
    if name not in compiled.REFERENCES:
        root = Path(compiled.__path__[0]).parents[2]
        for file in map(Path, list_sources(root)):
            if file.suffix == ".c" and file.parent.name != "compiled":
                import_module(".".join(file.with_suffix("").parts))
    return compiled.REFERENCES[name]


def get_compiled(name: str) -> Callable[..., Any]:
    """Return a function of the layer, also where the switch uses the Python text."""
    return getattr(import_module(compiled.LAYER), name)


def call(function: Callable[..., Any], *arguments: Any) -> Any:
    try:
        with np.errstate(all="ignore"):
            return function(*arguments)
    except REFUSALS:
        return REFUSALS


def describe(value: Any) -> Any:
    """Return all types and bits in a form that `==` compares; any NaN equals any other."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, describe(value.tolist())
    if isinstance(value, float):
        return "nan" if value != value else value.hex()
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), [describe(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, dict):
        return [(key, describe(item)) for key, item in value.items()]
    if isinstance(value, tuple | list):
        return type(value), [describe(item) for item in value]
    return value
