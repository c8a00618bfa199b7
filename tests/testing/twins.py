"""Compare compiled functions with the Python text that says what they compute."""

import ctypes
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import numpy as np

from mdrive_sumo.core import compiled

REFUSALS = (ValueError, ArithmeticError)
"""What a function raises for numbers that it cannot use; which of them may differ between twins."""
COMPARED: Counter[tuple[str, bool]] = Counter()
"""How often a function was compared in this process where it returned, and where it refused its arguments."""


def compare_twins(name: str, *arguments: Any) -> Any:
    """Return what both functions of that name (as in `compiled.REFERENCES`) return; the bits must be equal.

    The compiled one must leave no memory and no reference behind; that is looked at for the first, second, fourth,
    eighth ... of the calls that return and of those that are refused.
    """
    expected = call(compiled.REFERENCES[name], *arguments)
    found = call(get_compiled(name), *arguments)
    assert describe(found) == describe(expected), name
    kind = name, found is REFUSALS
    COMPARED[kind] += 1
    if COMPARED[kind].bit_count() == 1:
        check_memory(get_compiled(name), *arguments)
    return found


def check_memory(function: Callable[..., Any], *arguments: Any) -> None:
    """Assert that calls keep no memory, no references to arguments, and give back none that is not theirs.

    What a few calls leave is looked at again after many: Python keeps up to 2000 tuples of a length for later, and
    NumPy has such stores too.
    """
    parts = list(list_parts(arguments))
    for calls in (4, 2500):
        call(function, *arguments)
        before = measure_memory(parts)
        for _ in range(calls):
            call(function, *arguments)
        grown = [count - was for count, was in zip(measure_memory(parts), before, strict=True)]
        if max(grown) < calls and min(grown[2:], default=0) > -calls:
            return
    raise AssertionError(f"{function.__name__}: {calls} calls with {arguments} add {grown} blocks, pieces, references")


def measure_memory(parts: list[Any]) -> list[int]:
    """Return counts of Python's blocks, of the C library's pieces, at most, and of references to each of the parts."""
    return [sys.getallocatedblocks(), _count_allocated_bytes() // LEAST_ALLOCATION, *map(sys.getrefcount, parts)]


LEAST_ALLOCATION = 32
"""Bytes that the GNU C library takes for the smallest piece of memory, its own notes included."""


def list_parts(value: Any) -> Iterator[Any]:
    """Return a value and what it consists of."""
    yield value
    if is_dataclass(value) and not isinstance(value, type):
        value = [getattr(value, field.name) for field in fields(value)]
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
