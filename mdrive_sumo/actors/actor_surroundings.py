"""The road users and objects of a frame, as scripted actors perceive them."""

from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.actors.path_tables import Rows
from mdrive_sumo.core.state import Actors, EgoState, Kind
from mdrive_sumo.vehicle import dynamics

CAR_SIZE = (dynamics.MKZ_2017.length, dynamics.MKZ_2017.width)
"""Length and width [m]: every CAV is the paper's car (protocol K6)."""
NO_MOVER = -1
"""Index of what is no scripted actor."""
STATIC = -2
"""Index of a scripted actor that never moves."""

SURROUNDING = np.dtype(
    [
        ("x", "f8"),  # [m]
        ("y", "f8"),
        ("yaw", "f8"),  # [rad]
        ("speed", "f8"),  # [m/s]
        ("half_length", "f8"),  # [m]
        ("half_width", "f8"),
        ("is_pedestrian", "?"),
        ("is_cav", "?"),
        ("index", "i8"),  # among the moving scripted actors, or one of the constants above
    ]
)


def list_surroundings(egos: Sequence[EgoState], actors: Actors, index_by_id: Mapping[str, int]) -> Rows:
    """Return all O road users and objects of a frame, (O,) of `SURROUNDING`: CAVs first, then actors."""
    surroundings = np.zeros(len(egos) + len(actors), SURROUNDING)
    cavs, others = surroundings[: len(egos)], surroundings[len(egos) :]
    for name in ("x", "y", "yaw", "speed"):
        cavs[name] = [getattr(ego, name) for ego in egos]
        others[name] = getattr(actors, name)
    cavs["half_length"], cavs["half_width"] = CAR_SIZE[0] / 2, CAR_SIZE[1] / 2
    others["half_length"], others["half_width"] = actors.length / 2, actors.width / 2
    others["is_pedestrian"] = actors.kind == Kind.PEDESTRIAN
    cavs["is_cav"] = True
    cavs["index"] = NO_MOVER
    others["index"] = [index_by_id.get(name, NO_MOVER) for name in actors.ids]
    return surroundings
