"""Kind of place: a crossing of streets with 3 to 5 arms."""

import random
from dataclasses import dataclass

from mdrive_sumo.worlds.places.junctions import JunctionPlan, build_junction
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.place import PlaceKind
from mdrive_sumo.worlds.places.place_parameters import between, choose
from mdrive_sumo.worlds.places.street_houses import HouseRows, add_houses

ANGLES_DEG = {3: (0.0, 90.0, 180.0), 4: (0.0, 90.0, 180.0, 270.0), 5: (0.0, 65.0, 130.0, 205.0, 280.0)}


@dataclass(frozen=True)
class CrossingParameters:
    """Parameters of a crossing."""

    arms: int = choose(3, 4, 5, doc="Streets that meet.", weights=(3.0, 6.0, 1.0))
    control: str = choose("right_before_left", "priority", doc="Who goes first.")
    speed_kmh: float = choose(30.0, 50.0, doc="Speed limit [km/h].")
    jitter_deg: float = between(0.0, 10.0, doc="Largest deviation of an arm from its direction [deg].")


def build_crossing(draft: NetworkDraft, parameters: CrossingParameters, rng: random.Random) -> None:
    """Fill a draft with a crossing."""
    plan = JunctionPlan(
        ANGLES_DEG[parameters.arms],
        ((1, 1),) * parameters.arms,
        parameters.control,
        8.0,
        round(parameters.speed_kmh / 3.6, 2),
        (0, 2) if parameters.control == "priority" else (),
        bend=0.3,
        jitter_deg=parameters.jitter_deg,
    )
    build_junction(draft, plan, rng)
    add_houses(draft, HouseRows((4.0, 9.0)), rng)


CROSSING = PlaceKind("crossing", "a crossing of 3 to 5 streets", CrossingParameters, build_crossing)
