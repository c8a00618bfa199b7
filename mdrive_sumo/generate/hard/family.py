"""Scenario families of the hard tier: each builds one kind of situation from a few bounded parameters.

A family knows nothing of agents or scores; the search varies its parameters. Equal candidates make equal scenarios.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scenario import Scenario

BUCKET = "Hard"
"""Bucket of every scenario of the hard tier."""


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
    """One point of a family: everything that `ScenarioFamily.build` depends on."""

    scenario_id: str
    values: tuple[float, ...]
    """One for each of the family's parameters, in their order and within their bounds."""
    seed: str
    """Seed of all that the parameters leave open: traffic, sizes, weather."""


@dataclass(frozen=True, slots=True)
class ScenarioFamily:
    """A kind of situation and how to build one."""

    category: str
    """`Scenario.category` of its scenarios; unique among families."""
    description: str
    parameters: tuple[FamilyParameter, ...]
    build: Callable[[FamilyCandidate], Scenario]
    """Return the scenario of a candidate, without time limits. Raises `ProposalRejected` or `NoRoomError` if it is
    unsound."""


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


def build_encounter_parameters(
    own_m: tuple[float, float], own_speed: tuple[float, float], hidden_speed: tuple[float, float]
) -> tuple[FamilyParameter, ...]:
    """Return the parameters of `place_encounter` but `cavs` and `mast`, with bounds of distance and speeds."""
    return (
        FamilyParameter("own_m", *own_m, "m", "distance of CAV 0 from the conflict"),
        FamilyParameter("own_speed", *own_speed, "m/s", "start speed of CAV 0"),
        FamilyParameter("gap_s", -2.0, 2.0, "s", "how much later than CAV 0 the hidden vehicle reaches the conflict"),
        FamilyParameter("hidden_speed", *hidden_speed, "m/s", "speed of the hidden vehicle"),
        FamilyParameter("connected", 0.0, 1.0, "", "whether the hidden vehicle is a CAV (from 0.5 on)"),
        FamilyParameter("behind_m", 12.0, 30.0, "m", "distance of the witness behind the hidden vehicle"),
    )
