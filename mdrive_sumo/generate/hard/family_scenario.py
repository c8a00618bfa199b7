"""The scenario of a candidate: what families of the hard tier read, and what they check of what they built."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.family import BUCKET, FamilyCandidate, ScenarioFamily, check_candidate
from mdrive_sumo.generate.pipeline import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, StandingMotion
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.worlds.placement.occupancy import build_user_box, overlaps_building

LEAST_CAVS, MOST_CAVS = 2, 12
"""CAVs of a scenario of the hard tier (docs/hard.md)."""


def read_values(family: ScenarioFamily, candidate: FamilyCandidate) -> dict[str, float]:
    """Return the candidate's values by parameter name. Raises InputError for values out of bounds."""
    check_candidate(family, candidate)
    names = [parameter.name for parameter in family.parameters]
    return dict(zip(names, candidate.values, strict=True))


def load_network(name: str) -> RoadMap:
    """Return a packaged network."""
    return load_road_map(find_network_folder(name))


@dataclass(frozen=True, slots=True)
class FamilyTraffic:
    """What a scenario holds beside its CAVs."""

    vehicles: tuple[BackgroundVehicle, ...] = ()
    actors: tuple[Actor, ...] = ()
    rsus: tuple[RoadsideUnit, ...] = ()
    signals: bool = False
    """Whether traffic lights run their programs."""


def build_scenario(
    family: ScenarioFamily, candidate: FamilyCandidate, roads: RoadMap, egos: Sequence[Ego], traffic: FamilyTraffic
) -> Scenario:
    """Return the scenario of a candidate.

    Raises ProposalRejected if it is not sound: fewer than 2 or more than 12 CAVs, off the road, or road users inside
    each other.
    """
    if not LEAST_CAVS <= len(egos) <= MOST_CAVS:
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"expected {LEAST_CAVS} to {MOST_CAVS} CAVs, found {len(egos)}")
    scenario = Scenario(
        id=candidate.scenario_id,
        bucket=BUCKET,
        category=family.category,
        network=roads.name,
        description=family.description,
        signals="program" if traffic.signals else "frozen-green",
        speeds="road",
        egos=tuple(egos),
        background=Background(vehicles=traffic.vehicles),
        actors=traffic.actors,
        rsus=traffic.rsus,
    )
    try:
        check_scenario(scenario, roads)
    except InputError as error:
        raise ProposalRejected(PipelineStage.SOUNDNESS, str(error)) from None
    if inside := next(_find_parked_in_buildings(scenario, roads), None):
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"scenario {scenario.id}: {inside} stands inside a building")
    if overlap := next(find_spawn_overlaps(scenario, roads), None):
        raise ProposalRejected(PipelineStage.SOUNDNESS, f"scenario {scenario.id}: {overlap}")
    return scenario


def _find_parked_in_buildings(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    """Return the ids of standing vehicles that overlap a building."""
    for actor in scenario.actors:
        if isinstance(actor.motion, StandingMotion) and overlaps_building(build_user_box(actor), roads):
            yield actor.id
