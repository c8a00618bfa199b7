"""Places of training scenarios: drawn by the factory of places, in a namespace of seeds that no suite uses.

A place costs a call of netconvert, so several scenarios share one. Places lie in a folder that can be brought along to
hosts without netconvert; what is missing there is drawn.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.drawn_places import PlaceChoice, draw_fitting_network
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.learning.sample_format import SCENARIOS_PER_PLACE, SPLITS
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.worker_process import WorkerFailure
from mdrive_sumo.worlds.network_features import NetworkFeatures
from mdrive_sumo.worlds.places.place_parameters import Value

SEED_NAMESPACE: Final = "training"
"""Beginning of the seed of every place for training; seeds of seasons and of the hard tier are checksums."""
PLACE_LIMIT_S: Final = 300.0
"""Wall clock for one place; on a busy machine netconvert takes some seconds."""


def _repeat(count: int, kind: str, **parameters: Value) -> tuple[PlaceChoice, ...]:
    return (PlaceChoice(kind, parameters),) * count


def _draw_motorways(count: int, kind: str) -> tuple[PlaceChoice, ...]:
    """Return a motorway with each limit up to 120 km/h = 33 m/s; one direction, in which all CAVs can meet."""
    return tuple(
        choice
        for limit_kmh in (80.0, 100.0, 120.0)
        for choice in _repeat(count, kind, carriageways=1, limit_kmh=limit_kmh)
    )


PLACE_CHOICES: Final[Sequence[PlaceChoice]] = (
    *_repeat(19, "crossing"),
    *_repeat(6, "crossing", area="open"),
    *_repeat(4, "crossing", arms=4, main_lanes=2),
    *_repeat(6, "roundabout"),
    *_repeat(3, "roundabout", area="open"),
    *_repeat(6, "town_block"),
    *_repeat(3, "car_park"),
    *_repeat(3, "driveways"),
    *(choice for junctions in (0, 1, 2) for choice in _repeat(4, "corridor", junctions=junctions)),
    *_repeat(7, "residential_street"),
    *_repeat(3, "arterial", junctions=0),
    *_repeat(5, "arterial", junctions=1),
    *_repeat(6, "country_road"),
    *_repeat(2, "country_road", roadside="open"),
    *_draw_motorways(1, "motorway_merge"),
    *_draw_motorways(1, "motorway_weave"),
    *_draw_motorways(1, "motorway_exit"),
    *_draw_motorways(1, "lane_drop"),
    *_repeat(3, "works_zone"),
)
"""What a place is drawn from, each entry equally often; chosen. Corridors and arterial roads with more junctions are
longer than scenarios need."""
KIND_SHARES: Final[Mapping[str, float]] = MappingProxyType(
    {
        kind: sum(choice.kind == kind for choice in PLACE_CHOICES) / len(PLACE_CHOICES)
        for kind in sorted({choice.kind for choice in PLACE_CHOICES})
    }
)
"""Share of the places of each kind."""


@dataclass(frozen=True, slots=True)
class TrainingPlace:
    """A place of a split, by its number; it can be sent to a worker process."""

    split: str
    seed: int
    number: int
    folder: Path
    """Folder in which places lie."""

    def __post_init__(self) -> None:
        """Raises InputError for a split that there is not."""
        if self.split not in SPLITS:
            raise InputError(f"split: expected one of {', '.join(SPLITS)}, found {self.split!r}")

    @property
    def place_seed(self) -> str:
        """Seed of its draws: splits have no place in common."""
        return f"{SEED_NAMESPACE}/{self.split}/{self.seed}/{self.number}"


def find_place(split: str, seed: int, index: int, folder: Path) -> TrainingPlace:
    """Return the place of the scenario with an index. Raises InputError for a split that there is not."""
    return TrainingPlace(split, seed, index // SCENARIOS_PER_PLACE, folder)


@lru_cache(maxsize=4)  # scenarios come in their order, and checks of a network take as long as to draw a scenario
def open_training_place(place: TrainingPlace) -> tuple[str, RoadMap]:
    """Return kind and road map of a place, which is drawn into its folder unless it is there.

    Raises ProposalRejected if none of the draws is sound, which is unlikely; InputError without netconvert.
    """
    about, roads = draw_fitting_network(PLACE_CHOICES, _has_any_shape, place.place_seed, place.folder)
    return about.kind, roads


def _has_any_shape(_features: NetworkFeatures) -> bool:
    """Accept every sound place of which features can be told: situations are chosen to suit it."""
    return True


def draw_training_places(
    split: str, seed: int, scenarios: int, folder: Path, workers: int, note: Callable[[str], None]
) -> None:
    """Draw the places of the first scenarios that the folder lacks, in worker processes. Raises InputError."""
    count = -(-scenarios // SCENARIOS_PER_PLACE)
    places = [TrainingPlace(split, seed, number, folder) for number in range(count)]
    with make_executor(_draw_place, min(workers, count), PLACE_LIMIT_S) as executor:
        for place, outcome in run_jobs(executor, places):
            if isinstance(outcome, WorkerFailure):
                raise InputError(f"place {place.number} of split {place.split}: {outcome.reason}")
    note(f"{_count(len(places), 'place')} for {_count(scenarios, 'scenario')}: {folder}")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _draw_place(place: TrainingPlace) -> str:
    """Draw a place into its folder; return the name of its network, "" if no draw was sound."""
    try:
        return open_training_place(place)[1].name
    except ProposalRejected:
        return ""
