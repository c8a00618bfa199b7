"""Parameters and made-up examples of which `make test` takes a sample; `make test-all` takes all."""

import os
from collections.abc import Collection, Iterable
from typing import TypeVar

import pytest
from _pytest.mark.structures import ParameterSet

T = TypeVar("T")


def sampled(values: Iterable[T], kept: Collection[T]) -> list[ParameterSet]:
    """The values as parameters; those that are not `kept` are marked `full`."""
    values = tuple(values)
    assert set(kept) <= set(values), f"{set(kept) - set(values)} are no values"
    return [pytest.param(value, marks=() if value in kept else pytest.mark.full) for value in values]


def examples(usual: int, thorough: int) -> int:
    """How many examples a property gets that takes long or needs many: `thorough` of them in `make test-all`."""
    return thorough if os.environ.get("TESTS_PROFILE") == "all" else usual
