"""Proposal: what a proposer (template or language model) says about a scenario before there is any geometry.

Fields and values follow the schema of MDrive's generator (protocol 14.1); `pre_crash` is ours.
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.worlds.network_features import Topology

VehicleId = Annotated[str, Field(pattern=r"^Vehicle [1-9][0-9]?$")]
ActorId = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
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
ActorKind = Literal["static_prop", "parked_vehicle", "walker", "cyclist", "npc_vehicle"]
Lateral = Literal[
    "center",
    "half_right",
    "right_edge",
    "offroad_right",
    "sidewalk_right",
    "half_left",
    "left_edge",
    "offroad_left",
    "sidewalk_left",
]
Phase = Literal["on_approach", "after_turn", "in_intersection", "after_exit", "after_merge", "unknown"]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class EgoVehicle(_Part):
    """A CAV: what it does and, at a junction, from which road to which."""

    vehicle_id: VehicleId
    maneuver: Maneuver
    lane_change_phase: Literal["before_intersection", "after_intersection", "unknown"] = "unknown"
    entry_road: Road = "unknown"
    exit_road: Road = "unknown"


class VehicleConstraint(_Part):
    """`a` stands in this relation to `b`: "a same_approach_as b"."""

    type: ConstraintType
    a: VehicleId
    b: VehicleId


class ProposedActor(_Part):
    """A road user or thing beside the CAVs, placed relative to the way of `affects_vehicle`."""

    actor_id: ActorId
    kind: ActorKind
    quantity: int = Field(default=1, ge=1, le=8)
    group_pattern: Literal["across_lane", "along_lane", "diagonal", "unknown"] = "unknown"
    start_lateral: Lateral | None = None
    end_lateral: Lateral | None = None
    """Ends of a group that lies across or diagonal."""
    affects_vehicle: VehicleId
    timing_phase: Phase = "on_approach"
    lateral_position: Lateral = "center"
    motion: Literal["static", "cross_perpendicular", "follow_lane", "straight_line"] = "static"
    speed: Literal["stopped", "slow", "normal", "fast", "erratic", "unknown"] = "unknown"
    crossing_direction: Literal["left", "right"] | None = None
    direction_relative_to: Literal["same", "opposite"] | None = None


class Proposal(_Part):
    """One scenario as it is proposed. `rules.problems` says what is wrong with it."""

    category: Category
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
