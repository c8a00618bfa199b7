"""The kinds of places by name."""

from collections.abc import Mapping

from mdrive_sumo.worlds.places.arterial import ARTERIAL
from mdrive_sumo.worlds.places.corridor import CORRIDOR
from mdrive_sumo.worlds.places.country_road import COUNTRY_ROAD
from mdrive_sumo.worlds.places.crossing import CROSSING
from mdrive_sumo.worlds.places.driveways import CAR_PARK, DRIVEWAYS
from mdrive_sumo.worlds.places.motorway import MOTORWAY_KINDS
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.residential_street import RESIDENTIAL_STREET
from mdrive_sumo.worlds.places.roundabout import ROUNDABOUT
from mdrive_sumo.worlds.places.town_block import TOWN_BLOCK
from mdrive_sumo.worlds.places.works_zone import WORKS_ZONE

JUNCTION_KINDS = (CROSSING, ROUNDABOUT, TOWN_BLOCK, CAR_PARK, DRIVEWAYS)
STREET_KINDS = (CORRIDOR, RESIDENTIAL_STREET, ARTERIAL, COUNTRY_ROAD, *MOTORWAY_KINDS, WORKS_ZONE)
PLACE_KINDS: Mapping[str, PlaceKind] = {kind.name: kind for kind in (*JUNCTION_KINDS, *STREET_KINDS)}
