"""The kinds of places by name."""

from collections.abc import Mapping

from mdrive_sumo.worlds.places.corridor import CORRIDOR
from mdrive_sumo.worlds.places.crossing import CROSSING
from mdrive_sumo.worlds.places.motorway import MOTORWAY_KINDS
from mdrive_sumo.worlds.places.place import PlaceKind

PLACE_KINDS: Mapping[str, PlaceKind] = {kind.name: kind for kind in (CROSSING, CORRIDOR, *MOTORWAY_KINDS)}
