"""The kinds of places by name; draw a place of one, or take a packaged network by its name."""

from collections.abc import Mapping

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.worlds.places.arterial import ARTERIAL
from mdrive_sumo.worlds.places.corridor import CORRIDOR
from mdrive_sumo.worlds.places.country_road import COUNTRY_ROAD
from mdrive_sumo.worlds.places.crossing import CROSSING
from mdrive_sumo.worlds.places.driveways import CAR_PARK, DRIVEWAYS
from mdrive_sumo.worlds.places.motorway import MOTORWAY_KINDS
from mdrive_sumo.worlds.places.place import Place, PlaceKind, draw_place_of_kind
from mdrive_sumo.worlds.places.place_parameters import Value
from mdrive_sumo.worlds.places.residential_street import RESIDENTIAL_STREET
from mdrive_sumo.worlds.places.roundabout import ROUNDABOUT
from mdrive_sumo.worlds.places.town_block import TOWN_BLOCK
from mdrive_sumo.worlds.places.works_zone import WORKS_ZONE

JUNCTION_KINDS = (CROSSING, ROUNDABOUT, TOWN_BLOCK, CAR_PARK, DRIVEWAYS)
STREET_KINDS = (CORRIDOR, RESIDENTIAL_STREET, ARTERIAL, COUNTRY_ROAD, *MOTORWAY_KINDS, WORKS_ZONE)
PLACE_KINDS: Mapping[str, PlaceKind] = {kind.name: kind for kind in (*JUNCTION_KINDS, *STREET_KINDS)}


def draw_place(kind: str, seed: int | str = 0, **parameters: Value) -> Place:
    """Return a place: of a kind, drawn from a seed, or the packaged network of that name, which has no parameters.

    parameters: values of some parameters of the kind; the others are drawn. Raises InputError.
    """
    if kind in PLACE_KINDS:
        return draw_place_of_kind(PLACE_KINDS[kind], seed, parameters)
    presets = list_packaged_networks()
    if kind not in presets:
        names = (*PLACE_KINDS, *presets)
        raise InputError(f"place: {describe_unknown(kind, names)}")
    if parameters:
        unused = next(iter(parameters))
        raise InputError(f"place {kind!r}: expected no parameters for a packaged network, found {unused!r}")
    return Place(kind, kind, seed, {}, read_network_file(presets[kind]).description, None)
