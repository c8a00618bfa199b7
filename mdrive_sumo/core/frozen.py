"""Instances of frozen dataclasses for code that runs for every CAV and tick: `__init__` takes 4 to 8 times as long."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from mdrive_sumo.core.compiled import twin

Fields = ParamSpec("Fields")
Instance = TypeVar("Instance")


@twin
def build_frozen(cls: Callable[Fields, Instance], /, *values: Fields.args, **no_names: Fields.kwargs) -> Instance:
    """Return an instance of a frozen dataclass with slots and without `__post_init__`; values of all of its fields."""
    return cls(*values, **no_names)
