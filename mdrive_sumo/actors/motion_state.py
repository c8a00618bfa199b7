"""Advance all moving scripted actors by one tick, as pure array arithmetic."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.actors.kinematic_limits import LIMITS_BY_KIND, compute_safe_speed
from mdrive_sumo.actors.path_tables import PathPoints, PathTables
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor

STANDSTILL_SPEED = 1e-3
"""A speed below this [m/s], the resolution of a recording, is set to 0."""


@dataclass(frozen=True, slots=True)
class ActorParams:
    """Constant properties of the M moving actors; arrays are (M,). See `KinematicLimits`."""

    is_timed: Bool
    """Whether it is a replay, whose progress is its own clock [s]."""
    half_length: Float
    half_width: Float
    accel: Float
    comfort_brake: Float
    max_brake: Float
    gap: Float
    look_margin: Float
    clearance: Float
    prediction_s: Float


def build_actor_params(actors: Sequence[Actor]) -> ActorParams:
    """Return the parameters of the moving actors, in their order."""
    limits_of_actors = [LIMITS_BY_KIND[KIND_BY_NAME[actor.kind]] for actor in actors]
    names = ("accel", "comfort_brake", "max_brake", "gap", "look_margin", "clearance", "prediction_s")
    return ActorParams(
        np.array([actor.motion.type == "replay" for actor in actors], dtype=np.bool_),
        np.array([actor.length / 2 for actor in actors]),
        np.array([actor.width / 2 for actor in actors]),
        *(np.array([getattr(limits, name) for limits in limits_of_actors]) for name in names),
    )


@dataclass(frozen=True, slots=True)
class MotionState:
    """Progress of the M moving actors on their paths; arrays are (M,)."""

    progress: Float
    """Arc length [m]; for a replay its own clock [s]."""
    speed: Float
    clock_rate: Float
    """Rate of a replay's own clock: 1 is as logged."""


@dataclass(frozen=True, slots=True)
class MotionTarget:
    """Targets and limits of the M moving actors in this tick; arrays are (M,)."""

    script_speed: Float
    """Speed [m/s] that the script sets; infinite for a replay, which follows its log."""
    speed_limit: Float
    """Greatest speed [m/s] with respect to obstacles."""
    is_braking_fully: Bool
    is_stopped: Bool
    """Whether it stands at once: struck, or not yet triggered."""


def advance_motion(
    state: MotionState, points: PathPoints, target: MotionTarget, params: ActorParams, tables: PathTables
) -> MotionState:
    """Return the state one tick later. `points`: the path points at `state.progress`."""
    timed = params.is_timed
    room = np.where(timed, np.inf, np.maximum(tables.length - points.s, 0.0))
    speed_limit = np.minimum(target.speed_limit, compute_safe_speed(room, 0.0, params.comfort_brake))
    planned_speed = np.where(timed, np.minimum(points.slope, target.script_speed), target.script_speed)
    brake = np.where(target.is_braking_fully | timed, params.max_brake, params.comfort_brake)
    wanted_speed = np.minimum(np.maximum(planned_speed, state.speed - brake * DT), speed_limit)
    speed = np.clip(wanted_speed, np.maximum(state.speed - params.max_brake * DT, 0.0), state.speed + params.accel * DT)
    speed = np.where(speed < STANDSTILL_SPEED, 0.0, speed)
    unhindered = (
        timed & (state.clock_rate >= 1.0) & (speed_limit >= planned_speed)
    )  # a log may exceed the kinematic limits
    speed = np.where(target.is_stopped, 0.0, np.where(unhindered, planned_speed, speed))
    clock_rate = np.where(planned_speed > 1e-6, np.minimum(speed / np.maximum(planned_speed, 1e-6), 1.0), 1.0)
    clock_rate = np.where(target.is_stopped, 0.0, clock_rate)
    step = np.where(timed, clock_rate, speed) * DT
    progress = np.where(timed, state.progress + step, np.minimum(state.progress + step, tables.end))
    return MotionState(progress, speed, clock_rate)
