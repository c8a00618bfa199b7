"""A proposed actor: who or what is there beside the CAVs, relative to the way of one of them.

Fields and values follow the schema of MDrive's generator (protocol 14.1).
"""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

VehicleId = Annotated[str, Field(pattern=r"^Vehicle [1-9][0-9]?$")]
ActorId = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
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


class ProposalPart(BaseModel):
    """Base of a proposal and its parts."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ProposedActor(ProposalPart):
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

    @property
    def place(self) -> tuple[str, str]:
        """The CAV and the part of its way at which the actor is."""
        return self.affects_vehicle, self.timing_phase

    def name_member(self, number: int) -> str:
        """Return the id of a member of the group."""
        return self.actor_id if self.quantity == 1 else f"{self.actor_id}.{number}"
