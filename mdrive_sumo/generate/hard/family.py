"""Scenario families of the hard tier: each builds one kind of situation on a drawn place from a few bounded parameters.

A family knows nothing of agents or scores; the search varies its parameters. It finds its site on the map of the place
by geometry and right of way. Equal candidates on equal places make equal scenarios.
"""

import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.stream_contacts import find_stream_contacts
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected, reject_at
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.categories import WEATHER_OF_TEN
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, StandingMotion
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.scenario.weather import WeatherName
from mdrive_sumo.worlds.placement.occupancy import overlaps_building

BUCKET = "Hard"
"""Bucket of every scenario of the hard tier."""
LEAST_CAVS, MOST_CAVS = 2, 12
"""CAVs of a scenario of the hard tier (docs/hard.md)."""
Values = Mapping[str, float]
"""Values of a candidate by parameter name."""


@dataclass(frozen=True, slots=True)
class FamilyParameter:
    """A number that the search may vary, e.g. a start time, a speed, the place of an occluder or a traffic density."""

    name: str
    low: float
    high: float
    unit: str
    """e.g. "s", "m", "m/s", "veh/h"; "" for shares."""
    meaning: str
    """One phrase for docs and pictures."""


@dataclass(frozen=True, slots=True)
class FamilyCandidate:
    """One point of a family: everything that `ScenarioFamily.build` depends on besides the road map."""

    scenario_id: str
    place: str
    """Name of the place's network."""
    values: tuple[float, ...]
    """One for each of the family's parameters, in their order and within their bounds."""
    seed: str
    """Seed of all that the parameters leave open: traffic, sizes, weather."""


@dataclass(frozen=True, slots=True)
class FamilyScene:
    """What a scenario of a family holds besides its place."""

    egos: tuple[Ego, ...]
    vehicles: tuple[BackgroundVehicle, ...] = ()
    actors: tuple[Actor, ...] = ()
    rsus: tuple[RoadsideUnit, ...] = ()
    signals: bool = False
    """Whether traffic lights run their programs."""


@dataclass(frozen=True, slots=True)
class ScenarioFamily:
    """A kind of situation and how to build one."""

    category: str
    """`Scenario.category` of its scenarios; unique among families."""
    description: str
    places: tuple[PlaceChoice, ...]
    """Kinds of places on which the situation can be staged."""
    parameters: tuple[FamilyParameter, ...]
    """One that is named `site`, from 0 to 1, picks among the sites that the place has."""
    stage: Callable[[Values, str, RoadMap], FamilyScene]
    """Return the scene of a candidate's values and its seed on a road map.

    Raises `ProposalRejected` or `NoRoomError`, also where the place has no site.
    """

    def build(self, candidate: FamilyCandidate, roads: RoadMap) -> Scenario:
        """Return the scenario of a candidate, without time limits, in a weather that its seed draws.

        Raises `ProposalRejected` or `NoRoomError` if it is not sound: fewer than 2 or more than 12 CAVs, off the road,
        or road users inside each other. Raises InputError for values out of bounds.
        """
        check_candidate(self, candidate)
        names = [parameter.name for parameter in self.parameters]
        scene = self.stage(dict(zip(names, candidate.values, strict=True)), candidate.seed, roads)
        if not LEAST_CAVS <= len(scene.egos) <= MOST_CAVS:
            raise ProposalRejected(
                PipelineStage.SOUNDNESS, f"expected {LEAST_CAVS} to {MOST_CAVS} CAVs, found {len(scene.egos)}"
            )
        scenario = Scenario(
            id=candidate.scenario_id,
            bucket=BUCKET,
            category=self.category,
            network=roads.name,
            weather=draw_weather(candidate.seed),
            description=self.description,
            signals="program" if scene.signals else "frozen-green",
            speeds="road",
            egos=scene.egos,
            background=Background(vehicles=scene.vehicles),
            actors=scene.actors,
            rsus=scene.rsus,
        )
        with reject_at(PipelineStage.SOUNDNESS):
            check_scenario(scenario, roads)
        if problem := next(_find_contacts(scenario, roads), None):
            raise ProposalRejected(PipelineStage.SOUNDNESS, f"scenario {scenario.id}: {problem}")
        return scenario


def draw_weather(seed: str) -> WeatherName:
    """Return the weather of a scenario: clear, cloudy, rain or night, as often as in Interaction."""
    names, shares = tuple(WEATHER_OF_TEN), tuple(WEATHER_OF_TEN.values())
    return random.Random(f"{seed}/weather").choices(names, shares)[0]


def _find_contacts(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    """Yield what stands inside a building, road users inside each other, and what a stream touches on its way."""
    for actor in scenario.actors:
        if isinstance(actor.motion, StandingMotion) and overlaps_building(build_user_box(actor), roads):
            yield f"{actor.id} stands inside a building"
    yield from find_spawn_overlaps(scenario, roads)
    yield from find_stream_contacts(scenario, roads)


def check_candidate(family: ScenarioFamily, candidate: FamilyCandidate) -> None:
    """Check number and bounds of a candidate's values. Raises InputError."""
    if len(candidate.values) != len(family.parameters):
        raise InputError(f"{family.category}: expected {len(family.parameters)} values, found {len(candidate.values)}")
    for parameter, value in zip(family.parameters, candidate.values, strict=True):
        if not parameter.low <= value <= parameter.high:
            raise InputError(
                f"{family.category}: {parameter.name}: expected {parameter.low:g} to {parameter.high:g}"
                f" {parameter.unit}, found {value:g}"
            )
