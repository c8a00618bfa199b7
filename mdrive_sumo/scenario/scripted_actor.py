"""Scripted road users in a scenario file: kind, motion, trigger and action (protocol 3.3 to 3.5).

Static props, pedestrians, cyclists, vehicles with an authored path, and actors that replay a log. `mdrive_sumo.actors`
moves them; vehicles driven by SUMO are `background.BackgroundVehicle`.
"""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from mdrive_sumo.core.state import Kind
from mdrive_sumo.scenario.scenario_part import Coordinate, Identifier, Pose, ScenarioPart, Seconds, Speed


class StandingMotion(ScenarioPart):
    """Stays at its start."""

    type: Literal["standing"] = "standing"


class PathMotion(ScenarioPart):
    """Follows an authored polyline exactly; the first point is the start."""

    type: Literal["path"] = "path"
    points: tuple[tuple[Coordinate, Coordinate], ...] = Field(min_length=2)
    """x, y [m] of the box centre."""
    speed: Speed
    """Target speed [m/s]."""
    start_speed: Speed = 0.0


class LaneMotion(ScenarioPart):
    """Follows the centre lines of lanes (a SUMO route with its junction lanes), beginning at the start."""

    type: Literal["lanes"] = "lanes"
    lanes: tuple[str, ...] = Field(min_length=1)
    """SUMO lane ids in driving order, as in `Ego.lanes`."""
    speed: Speed
    start_speed: Speed = 0.0


class ReplayMotion(ScenarioPart):
    """Replays timed poses with linear interpolation; the actor is present from the first to the last of them."""

    type: Literal["replay"] = "replay"
    poses: tuple[tuple[Seconds, Coordinate, Coordinate, Coordinate], ...] = Field(min_length=2)
    """Time since the start of the scenario [s], x, y [m], yaw [rad]; times strictly increasing."""
    stays: bool = False
    """Whether it stays at its last pose instead of leaving."""

    @model_validator(mode="after")
    def _check_times(self) -> "ReplayMotion":
        times = [pose[0] for pose in self.poses]
        for i, (before, after) in enumerate(pairwise(times)):
            if after <= before:
                raise ValueError(f"replay: expected times that increase, found {after} s after {before} s at {i + 1}")
        return self


Motion = Annotated[StandingMotion | PathMotion | LaneMotion | ReplayMotion, Field(discriminator="type")]


class DistanceTrigger(ScenarioPart):
    """Fires when a CAV is within a distance, centre to centre (protocol 3.4)."""

    type: Literal["distance_to_vehicle"] = "distance_to_vehicle"
    vehicle: Identifier
    """Id of a CAV."""
    distance_m: float = Field(default=8.0, ge=1, le=50)


class TimeTrigger(ScenarioPart):
    """Fires at a time since the start."""

    type: Literal["time"] = "time"
    at_s: Seconds


class PositionTrigger(ScenarioPart):
    """Fires when a CAV's centre is within a circle."""

    type: Literal["at_position"] = "at_position"
    vehicle: Identifier
    x: Coordinate
    y: Coordinate
    radius_m: float = Field(default=3.0, gt=0, le=50)


class GapTrigger(ScenarioPart):
    """Fires at the first gap in the traffic on the first stretch of the actor's path, for people who cross a road.

    No vehicle or cyclist, CAVs included, is so near that it could not stop comfortably before the stretch. Once the
    actor walks there, SUMO's traffic yields on all lanes that are left to cross, as drivers do at a zebra crossing.
    """

    type: Literal["gap"] = "gap"
    after_s: Seconds = 0.0
    """It looks for a gap from this time since the start on."""


Trigger = Annotated[DistanceTrigger | TimeTrigger | PositionTrigger | GapTrigger, Field(discriminator="type")]


class StartMotion(ScenarioPart):
    """Stands until triggered, then follows its motion (protocol 3.4)."""

    type: Literal["start_motion"] = "start_motion"


class HardBrake(ScenarioPart):
    """When triggered, but not before a minimum drive: full brake to a standstill, hold, resume."""

    type: Literal["hard_brake"] = "hard_brake"
    hold_s: Seconds = 2.0
    resume_speed: Speed | None = None
    """Target speed [m/s] after the hold; None: as before."""
    pacing: bool = True
    """Whether it adapts its speed before the trigger so that it meets the CAV (protocol 3.4)."""
    least_driven_s: Seconds = 3.0
    least_driven_m: float = Field(default=0.0, ge=0, le=1000)


class LaneChange(ScenarioPart):
    """When triggered, but not before a minimum drive: 5 m straight, then 25 m of transition to the next lane."""

    type: Literal["lane_change"] = "lane_change"
    direction: Literal["left", "right"] | None = None
    """None: toward the lane of `target_vehicle`, else left."""
    target_vehicle: Identifier | None = None
    """Id of a CAV."""
    pacing: bool = True
    least_driven_s: Seconds = 3.0
    least_driven_m: float = Field(default=0.0, ge=0, le=1000)


Action = Annotated[StartMotion | HardBrake | LaneChange, Field(discriminator="type")]
KindName = Literal["vehicle", "pedestrian", "cyclist", "static"]
KIND_BY_NAME: dict[KindName, Kind] = {
    "vehicle": Kind.VEHICLE,
    "pedestrian": Kind.PEDESTRIAN,
    "cyclist": Kind.CYCLIST,
    "static": Kind.STATIC,
}


class Actor(ScenarioPart):
    """A scripted road user or a prop. Its kind determines the penalty of a collision; a parked car is a vehicle."""

    id: Identifier
    kind: KindName
    model: str = Field(default="", max_length=80)
    """A name of `props.PROPS`, a CARLA blueprint or a category of a log. Independent of its size."""
    length: float = Field(gt=0, le=40)
    width: float = Field(gt=0, le=40)
    """[m]"""
    start: Pose
    motion: Motion = StandingMotion()
    avoid_collision: bool = True
    """Whether it stops for obstacles ahead. The original ignores this flag; `--actors original` does too."""
    mirrored: bool = True
    """Whether SUMO's traffic reacts to it. Off for obstacles partly in a lane that traffic passed in the log."""
    trigger: Trigger | None = None
    action: Action | None = None
    """Action of the trigger; a trigger without action means `start_motion`."""

    @model_validator(mode="after")
    def _check_combination(self) -> "Actor":
        if self.trigger is None and self.action is not None:
            raise ValueError(f"actor {self.id}: expected a trigger for its action {self.action.type}, found none")
        if self.trigger is not None and isinstance(self.motion, StandingMotion):
            raise ValueError(f"actor {self.id}: expected a motion that its trigger sets off, found standing")
        if isinstance(self.trigger, GapTrigger) and not isinstance(self.motion, PathMotion):
            raise ValueError(f"actor {self.id}: expected a path for the trigger gap, found {self.motion.type}")
        if isinstance(self.action, HardBrake | LaneChange) and not isinstance(self.motion, PathMotion | LaneMotion):
            raise ValueError(
                f"actor {self.id}: expected a path or lanes for {self.action.type}, found {self.motion.type}"
            )
        return self

    @property
    def stream(self) -> str:
        """Name of the stream of a road user that comes one behind the other with others of its model and brakes for
        nothing: its model and its id without the number at the end; "" for every other actor."""
        if self.avoid_collision or not isinstance(self.motion, ReplayMotion):
            return ""
        return f"{self.model} {self.id.rstrip('0123456789')}"

    @property
    def referenced_cav_ids(self) -> tuple[str, ...]:
        """Ids of the CAVs that the trigger and the action refer to."""
        named = (
            getattr(self.trigger, "vehicle", None),
            getattr(self.action, "target_vehicle", None),
        )
        return tuple(name for name in named if name is not None)
