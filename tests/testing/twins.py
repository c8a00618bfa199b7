"""Compare compiled functions with the Python text that says what they compute."""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

import numpy as np

from mdrive_sumo.core import compiled

REFUSALS = (ValueError, ArithmeticError)
"""What a function raises for numbers that it cannot use; which of them may differ between twins."""


def compare_twins(name: str, *arguments: Any) -> Any:
    """Return what both functions of that name (as in `compiled.REFERENCES`) return; the bits must be equal."""
    expected = call(compiled.REFERENCES[name], *arguments)
    found = call(get_compiled(name), *arguments)
    assert describe(found) == describe(expected), name
    return found


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
