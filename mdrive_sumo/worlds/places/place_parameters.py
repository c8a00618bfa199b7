"""Parameters of a kind of place: a frozen dataclass whose fields say which values may be drawn.

    @dataclass(frozen=True)
    class CrossingParameters:
        arms: int = choose(3, 4, 5, doc="Streets that meet.", weights=(3, 6, 1))
        speed_kmh: float = between(30.0, 60.0, doc="Speed limit [km/h].")

Each parameter is drawn by a random stream of its own: to name one leaves the others as they are.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from hashlib import blake2b
from typing import Any, TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown

PLACES_VERSION = 1
"""Part of every seed of a place. It is raised when the same seed would make another place."""

Value = str | int | float | bool
Parameters = TypeVar("Parameters")
Drawn = Mapping[str, Any]
"""Values of the parameters that stand above one in the class."""


@dataclass(frozen=True, slots=True)
class ValueChoice:
    """Values that a parameter may have."""

    values: tuple[Value, ...]
    weigh: Callable[[Drawn], tuple[float, ...]]

    def draw(self, rng: random.Random, drawn: Drawn) -> Value:
        """Return one of the values by its weight."""
        return rng.choices(self.values, self.weigh(drawn))[0]

    def check(self, value: object) -> Value | None:
        """Return the value in the type of the list, or None for one that is not in it."""
        return next((v for v in self.values if v == value and isinstance(value, bool) == isinstance(v, bool)), None)

    def __str__(self) -> str:
        return ", ".join(str(value).lower() if isinstance(value, bool) else str(value) for value in self.values)


@dataclass(frozen=True, slots=True)
class NumberRange:
    """A range of numbers, both ends included."""

    low: float
    high: float
    limit: Callable[[Drawn], tuple[float, float]]
    """Range in which the number is drawn, given those above."""

    def draw(self, rng: random.Random, drawn: Drawn) -> float:
        """Return a number of the range, in tenths."""
        return round(rng.uniform(*self.limit(drawn)), 1)

    def check(self, value: object) -> float | None:
        """Return the value as a float, or None for one outside the range."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        return float(value) if self.low <= value <= self.high else None

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"


def choose(
    *values: Value, doc: str, weights: tuple[float, ...] | Callable[[Drawn], tuple[float, ...]] | None = None
) -> Any:
    """Return a field with one of `values`; weights: of each value, or a function of the parameters above it."""

    def weigh(drawn: Drawn) -> tuple[float, ...]:
        if weights is None:
            return (1.0,) * len(values)
        return weights(drawn) if callable(weights) else weights

    return field(metadata={"range": ValueChoice(values, weigh), "doc": doc})


def between(low: float, high: float, *, doc: str, limit: Callable[[Drawn], tuple[float, float]] | None = None) -> Any:
    """Return a field with a number from `low` to `high`; limit: narrower, by the parameters above it, where drawn."""
    return field(metadata={"range": NumberRange(low, high, limit or (lambda _: (low, high))), "doc": doc})


def list_ranges(parameters: type[Any]) -> dict[str, ValueChoice | NumberRange]:
    """Return the range of each parameter of a class, in order."""
    return {f.name: f.metadata["range"] for f in fields(parameters)}


def build_generator(*purpose: object) -> random.Random:
    """Return a random generator for a purpose, such as a kind, a seed and "draft"."""
    return random.Random(hash_words(*purpose, size=8))


def hash_words(*words: object, size: int) -> str:
    """Return a checksum of `size` bytes of the version of places and some words, in hexadecimal digits."""
    text = "\x00".join(map(str, (PLACES_VERSION, *words)))
    return blake2b(text.encode(), digest_size=size).hexdigest()


def draw_parameters(kind: str, parameters: type[Parameters], seed: int | str, given: Mapping[str, Value]) -> Parameters:
    """Return the parameters of a place: those that are given, and the others drawn. Raises InputError."""
    ranges = list_ranges(parameters)
    for name in given:
        if name not in ranges:
            raise InputError(f"parameter of place {kind!r}: {describe_unknown(name, ranges)}")
    values: dict[str, Value] = {}
    for name, allowed in ranges.items():
        if name not in given:
            values[name] = allowed.draw(build_generator(kind, seed, name), values)
            continue
        checked = allowed.check(given[name])
        if checked is None:
            raise InputError(f"parameter {name!r} of place {kind!r}: expected {allowed}, found {given[name]!r}")
        values[name] = checked
    return parameters(**values)
