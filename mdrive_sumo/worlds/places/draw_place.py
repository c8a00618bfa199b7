"""Draw a place by the name of its kind, or take a packaged network by its name."""

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.worlds.places.place import Place, draw_place_of_kind
from mdrive_sumo.worlds.places.place_kinds import PLACE_KINDS
from mdrive_sumo.worlds.places.place_parameters import Value
from mdrive_sumo.worlds.places.training_presets import TRAINING_PLANS, draw_training_network


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
    draft = draw_training_network(kind) if kind in TRAINING_PLANS else None
    return Place(kind, kind, seed, {}, read_network_file(presets[kind]).description, draft)
