"""Places of a season: which kinds fit a proposal, drawn until one does, and opened as a road map."""

import random
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.worlds.network_features import NetworkFeatures, Topology, extract_features
from mdrive_sumo.worlds.places import (
    PLACE_FILE,
    PLACE_KINDS,
    PLACES_VERSION,
    Place,
    check_place,
    draw_place,
    write_place,
)
from mdrive_sumo.worlds.places.place_files import PlaceFile
from mdrive_sumo.worlds.places.place_parameters import Value

DRAWS: Final = 6
"""Places that are drawn for a proposal before it is given up."""


@dataclass(frozen=True, slots=True)
class PlaceChoice:
    """A kind of place with some of its parameters fixed."""

    kind: str
    parameters: Mapping[str, Value] = field(default_factory=dict)


def list_choices(proposal: Proposal, *, at_signals: bool = False) -> Sequence[PlaceChoice]:
    """Return the kinds of places on which a proposal may be staged; one that is named twice is drawn twice as often.

    at_signals: of those with signals instead of those without. Raises KeyError for a topology that has none.
    """
    if at_signals:
        return CHOICES_AT_SIGNALS[proposal.topology, proposal.needs_multi_lane]
    return CHOICES[proposal.topology, proposal.needs_multi_lane, proposal.needs_on_ramp]


def _choose(kind: str, **parameters: Value) -> PlaceChoice:
    return PlaceChoice(kind, parameters)


_MOTORWAYS = tuple(
    _choose(kind, carriageways=1) for kind in ("motorway_merge", "motorway_weave", "motorway_exit", "lane_drop")
)
_BENDING_MOTORWAYS = tuple(
    _choose(kind, carriageways=1, limit_kmh=80.0)
    for kind in ("motorway_merge", "motorway_weave", "motorway_weave", "motorway_exit", "motorway_exit", "lane_drop")
)
"""In the paper's lane changes CAVs turn by 43 deg in 101 m: slow motorways have the tightest bends."""
_STREETS = (
    *(_choose("corridor", junctions=0, lanes=2, zebras=0, parking=side) for side in ("none", "one_side")),
    _choose("corridor", junctions=0, lanes=2, zebras=0, parking="none", sinuosity=0.0),
    _choose("arterial", junctions=0, lanes=2, sinuosity=0.0),
)
_JUNCTION_STREET = {
    lanes: _choose("corridor", junctions=1, lanes=lanes, signals="none", zebras=0, has_bus_stops=False)
    for lanes in (1, 2)
}
"""Two lanes have signals at a zebra crossing; the one between junctions does not touch the routes at one junction."""
_ROUNDABOUTS = tuple(
    _choose("roundabout", arms=arms, lanes=1, radius_m=radius_m, bend=bend)
    for arms, radius_m in ((3, 14.0), (4, 15.0), (4, 17.0))
    for bend in (0.4, 0.8)
)
"""Small ones: three quarters of a ring fit into the 112 m of the paper's routes, whose CAVs turn by 296 deg."""
_RULES = ("right_before_left", "priority", "stop", "all_way_stop")
"""Controls of a crossing without signals."""
CHOICES: Final[Mapping[tuple[Topology, bool, bool], Sequence[PlaceChoice]]] = {
    (Topology.INTERSECTION, False, False): (
        *(_choose("crossing", arms=4, control=control, main_lanes=1, side_lanes=1) for control in _RULES),
        _choose("crossing", arms=5, control="priority", main_lanes=1, side_lanes=1),
        _choose("crossing", arms=4, control="priority", main_lanes=2),
        _JUNCTION_STREET[1],
    ),
    (Topology.INTERSECTION, True, False): (
        _choose("crossing", arms=4, control="priority", main_lanes=2),
        _choose("crossing", arms=4, control="stop", main_lanes=2),
        _choose("crossing", arms=4, control="priority", main_lanes=2, side_lanes=2),
        _choose("crossing", arms=4, control="priority", main_lanes=3),
    ),
    (Topology.T_JUNCTION, False, False): (
        *(_choose("crossing", arms=3, control=control, main_lanes=1, side_lanes=1) for control in _RULES),
        _JUNCTION_STREET[1],
        _choose("residential_street", junctions=1, yards=0),
        _choose("country_road", tracks=1),
    ),
    (Topology.T_JUNCTION, True, False): (
        *(_choose("crossing", arms=3, control=control, main_lanes=2) for control in ("priority", "stop")),
        _JUNCTION_STREET[2],
    ),
    (Topology.CORRIDOR, False, False): _STREETS,
    (Topology.CORRIDOR, True, False): _STREETS,
    (Topology.TWO_LANE_CORRIDOR, False, False): (
        _choose("corridor", junctions=0, lanes=1, signals="none", parking="none", sinuosity=0.0),
        _choose("residential_street", junctions=0, yards=0, parking="none", sinuosity=0.0),
    ),
    (Topology.HIGHWAY, True, True): _MOTORWAYS[:2],
    (Topology.HIGHWAY, True, False): _BENDING_MOTORWAYS,
    (Topology.ROUNDABOUT, False, False): _ROUNDABOUTS,
}
"""By topology, whether several lanes are needed, and whether a ramp is. Those at junctions have no signals: what the
categories stage there is who goes first by signs or without (`CHOICES_AT_SIGNALS` has the others)."""
CHOICES_AT_SIGNALS: Final[Mapping[tuple[Topology, bool], Sequence[PlaceChoice]]] = {
    (Topology.INTERSECTION, False): (
        *(_choose("crossing", arms=4, control="signals", main_lanes=lanes) for lanes in (1, 2)),
        _choose("corridor", junctions=1, lanes=1, signals="all", zebras=0, has_bus_stops=False),
    ),
    (Topology.INTERSECTION, True): (
        _choose("crossing", arms=4, control="signals", main_lanes=2),
        _choose("crossing", arms=4, control="signals", main_lanes=2, side_lanes=2),
        _choose("crossing", arms=4, control="signals", main_lanes=3),
        _choose("corridor", junctions=1, lanes=2, signals="all", zebras=0, has_bus_stops=False),
        _choose("arterial", junctions=1, lanes=2),
    ),
    (Topology.T_JUNCTION, False): (_choose("crossing", arms=3, control="signals", main_lanes=1),),
    (Topology.T_JUNCTION, True): (_choose("crossing", arms=3, control="signals", main_lanes=2),),
}
"""Places with signals, by topology and whether several lanes are needed."""


def draw_fitting_network(
    choices: Sequence[PlaceChoice], fits: Callable[[NetworkFeatures], bool], seed: str, folder: Path
) -> tuple[PlaceFile, RoadMap]:
    """Draw places until one is sound and fits; each is in `folder`/NAME then. Raises ProposalRejected, and InputError
    without netconvert, unless all lie there."""
    rng = random.Random(f"{seed}/place")
    reason = ""
    for number in range(DRAWS):
        choice = rng.choice(choices)
        place = draw_place(choice.kind, f"{seed}-{number}" if choice.kind in PLACE_KINDS else 0, **choice.parameters)
        roads = compile_place(place, folder)
        faults = check_place(roads) if place.draft is not None else []
        if not faults and fits(extract_features(roads)):
            return describe_place(place), roads
        reason = f"network {place.name}: {faults[0] if faults else 'not what the proposal needs'}"
    raise ProposalRejected(PipelineStage.CROP, f"expected a place that fits among {DRAWS}, found {reason}")


def compile_place(place: Place, folder: Path) -> RoadMap:
    """Return the road map of a place, which is written to `folder`/NAME unless it lies there. Raises InputError."""
    home = folder / place.name
    is_written = (home / PLACE_FILE).is_file()  # the last file of `write_place`
    return load_road_map(home if is_written else write_place(place, home))


def describe_place(place: Place) -> PlaceFile:
    """Return what a place is drawn from, for a recipe."""
    return PlaceFile(version=PLACES_VERSION, kind=place.kind, seed=place.seed, parameters=dict(place.parameters))


def redraw_network(about: PlaceFile, folder: Path) -> RoadMap:
    """Draw the place of a recipe again into `folder`/NAME, unless it is there, and return its road map.

    Raises InputError for a place of another version.
    """
    if about.version != PLACES_VERSION:
        raise InputError(
            f"recipe: place: expected version {PLACES_VERSION}, which this release draws, found {about.version}:"
            " the release that drew the season rebuilds it"
        )
    return compile_place(draw_place(about.kind, about.seed, **about.parameters), folder)


@contextmanager
def open_place(about: PlaceFile) -> Generator[RoadMap]:
    """Yield the road map of a recipe's place, which is drawn again for as long."""
    with tempfile.TemporaryDirectory() as scratch:
        yield redraw_network(about, Path(scratch))
