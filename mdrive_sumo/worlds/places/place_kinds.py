"""The kinds of places by name."""

from collections.abc import Mapping

from mdrive_sumo.worlds.places.crossing import CROSSING
from mdrive_sumo.worlds.places.place import PlaceKind

PLACE_KINDS: Mapping[str, PlaceKind] = {kind.name: kind for kind in (CROSSING,)}
