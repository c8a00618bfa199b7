"""Parameters and made-up examples of which `make test` takes a sample; `make test-all` takes all."""

import os
from collections.abc import Collection, Iterable
from typing import TypeVar

import pytest
from _pytest.mark.structures import ParameterSet

T = TypeVar("T")
THOROUGH = "thorough"
"""The profile of hypothesis, named in MDRIVE_HYPOTHESIS, with which `make test-all` makes up all examples."""


def sampled(values: Iterable[T], kept: Collection[T]) -> list[ParameterSet]:
    """The values as parameters; those that are not `kept` are marked `full`."""
    values = tuple(values)
    assert set(kept) <= set(values), f"{set(kept) - set(values)} are no values"
    return [pytest.param(value, marks=() if value in kept else pytest.mark.full) for value in values]


def examples(usual: int, thorough: int) -> int:
    """How many examples of a property that takes long, or needs more than the profile has."""
    return thorough if os.environ.get("MDRIVE_HYPOTHESIS") == THOROUGH else usual
