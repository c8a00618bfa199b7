"""Places: parametric road networks, drawn from a seed and compiled by netconvert."""

from mdrive_sumo.worlds.places.check_place import check_place
from mdrive_sumo.worlds.places.draw_place import PLACE_KINDS, draw_place
from mdrive_sumo.worlds.places.place import PLACE_FILE, Place, PlaceKind
from mdrive_sumo.worlds.places.place_files import read_place, write_place
from mdrive_sumo.worlds.places.place_parameters import PLACES_VERSION, between, choose, list_ranges

__all__ = [
    "PLACES_VERSION",
    "PLACE_FILE",
    "PLACE_KINDS",
    "Place",
    "PlaceKind",
    "draw_place",
    "write_place",
    "read_place",
    "check_place",
    "choose",
    "between",
    "list_ranges",
]
