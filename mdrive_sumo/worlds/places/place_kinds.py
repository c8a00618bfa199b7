"""The kinds of places by name."""

from collections.abc import Mapping

from mdrive_sumo.worlds.places.corridor import CORRIDOR
from mdrive_sumo.worlds.places.crossing import CROSSING
from mdrive_sumo.worlds.places.driveways import CAR_PARK, DRIVEWAYS
from mdrive_sumo.worlds.places.motorway import MOTORWAY_KINDS
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.roundabout import ROUNDABOUT
from mdrive_sumo.worlds.places.town_block import TOWN_BLOCK

PLACE_KINDS: Mapping[str, PlaceKind] = {
    kind.name: kind for kind in (CROSSING, ROUNDABOUT, TOWN_BLOCK, CAR_PARK, DRIVEWAYS, CORRIDOR, *MOTORWAY_KINDS)
}
