"""Proposal: what a proposer (template or language model) says about a scenario before there is any geometry,
and what proposers write the fields of one with: CAVs, relations, queues behind the first CAVs.

Fields and values follow the schema of MDrive's generator (protocol 14.1); `pre_crash` is ours.
"""

import random
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, PlainSerializer, PlainValidator, WithJsonSchema

from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.scenario.categories import InterDriveCategory
from mdrive_sumo.scenario.scenario import shorten_value
from mdrive_sumo.worlds.encounters.proposed_actor import ProposalPart, ProposedActor, VehicleId
from mdrive_sumo.worlds.network_features import Topology

CATEGORY_NAMES = (*map(str, Category), *map(str, InterDriveCategory))


def read_category(name: str) -> Category | InterDriveCategory:
    """Return the category of a name. Raises ValueError."""
    if name not in CATEGORY_NAMES:
        raise ValueError(f"expected one of {', '.join(CATEGORY_NAMES)}, found {shorten_value(name)}")
    return InterDriveCategory(name) if name in set(InterDriveCategory) else Category(name)


AnyCategory = Annotated[
    Category | InterDriveCategory,
    PlainValidator(read_category),
    PlainSerializer(str, return_type=str),
    WithJsonSchema({"enum": list(CATEGORY_NAMES), "type": "string"}),
]
Maneuver = Literal["straight", "left", "right", "lane_change", "unknown"]
Road = Literal["main", "side", "unknown"]
ConstraintType = Literal[
    "same_approach_as",
    "opposite_approach_of",
    "perpendicular_right_of",
    "perpendicular_left_of",
    "same_exit_as",
    "same_road_as",
    "follow_route_of",
    "left_lane_of",
    "right_lane_of",
    "merges_into_lane_of",
    "same_lane_as",
]


class EgoVehicle(ProposalPart):
    """A CAV: what it does and, at a junction, from which road to which."""

    vehicle_id: VehicleId
    maneuver: Maneuver
    lane_change_phase: Literal["before_intersection", "after_intersection", "unknown"] = "unknown"
    entry_road: Road = "unknown"
    exit_road: Road = "unknown"


class VehicleConstraint(ProposalPart):
    """`a` stands in this relation to `b`: "a same_approach_as b"."""

    type: ConstraintType
    a: VehicleId
    b: VehicleId


class Proposal(ProposalPart):
    """One scenario as it is proposed. `rules.problems` says what is wrong with it."""

    category: AnyCategory
    topology: Topology
    needs_oncoming: bool = False
    needs_multi_lane: bool = False
    needs_on_ramp: bool = False
    needs_merge: bool = False
    ego_vehicles: tuple[EgoVehicle, ...] = Field(max_length=8)
    vehicle_constraints: tuple[VehicleConstraint, ...] = ()
    actors: tuple[ProposedActor, ...] = ()
    description: str = Field(default="", max_length=1000)
    pre_crash: int | None = Field(default=None, ge=1, le=37)
    """Number of the NHTSA pre-crash typology (Najm, Smith, Yanagisawa 2007); for the pre-crash category only."""


Draft = dict[str, Any]
"""Fields of a proposal or of a part of one."""


def draft_ego(number: int, maneuver: Maneuver = "straight", **more: str) -> Draft:
    """Return the fields of a CAV."""
    return {"vehicle_id": f"Vehicle {number}", "maneuver": maneuver, **more}


def draft_relation(a: int, type_: str, b: int) -> Draft:
    """Return the relation in which vehicle `a` stands to vehicle `b`."""
    return {"type": type_, "a": f"Vehicle {a}", "b": f"Vehicle {b}"}


def relate_followers(first: int, count: int, behind: Sequence[int], rng: random.Random) -> list[Draft]:
    """Return relations that put further CAVs behind the first ones."""
    return [draft_relation(n, "follow_route_of", rng.choice(list(behind))) for n in range(first, count + 1)]


def add_followers(egos: Sequence[Draft], relations: Sequence[Draft], count: int) -> list[Draft]:
    """Add CAVs that do what the CAV ahead of them does."""
    found = list(egos)
    for relation in relations:
        leader = next(ego for ego in found if ego["vehicle_id"] == relation["b"])
        found.append(leader | {"vehicle_id": relation["a"]})
    return found[:count]
