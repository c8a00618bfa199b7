"""Place: a network that is drawn from a kind, a seed and parameters; PlaceKind draws it."""

import random
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place_parameters import (
    Value,
    build_generator,
    draw_parameters,
    hash_words,
)

PLACE_FILE = "place.json"
"""File of a place's folder that says what it was drawn from."""
NAME_BYTES = 4
"""Bytes of the checksum in a place's name: two of a thousand places share a name once in 8 600 draws of a thousand."""


@dataclass(frozen=True)
class PlaceKind:
    """A kind of place, such as a crossing."""

    name: str
    description: str
    """One sentence for users."""
    parameters: type[Any]
    """Frozen dataclass of fields by `choose` and `between`."""
    build: Callable[[NetworkDraft, Any, random.Random], None]
    """Fill an empty draft by parameters, an instance of that class; may set its description."""


@dataclass(frozen=True, eq=False)
class Place:
    """A network before netconvert compiles it, with all that it was drawn from."""

    name: str
    """Name of the network: KIND_CHECKSUM, or that of a packaged network."""
    kind: str
    seed: int | str
    parameters: Mapping[str, Value]
    description: str
    draft: NetworkDraft | None
    """None for a packaged network."""


def draw_place_of_kind(kind: PlaceKind, seed: int | str, given: Mapping[str, Value]) -> Place:
    """Return the place of a kind for a seed; raise InputError for parameters outside their ranges."""
    parameters = draw_parameters(kind.name, kind.parameters, seed, given)
    values = asdict(parameters)
    name = f"{kind.name}_{hash_words(kind.name, seed, *values.items(), size=NAME_BYTES)}"
    draft = NetworkDraft(name, kind.description)
    kind.build(draft, parameters, build_generator(kind.name, seed, "draft"))
    return Place(name, kind.name, seed, values, draft.description, draft)
