"""Triggers and the actions that they start: a state machine without side effects, one `ScriptState` per actor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto

from mdrive_sumo.actors.gap_acceptance import is_gap
from mdrive_sumo.core import portable
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, EgoState, Frame
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    GapTrigger,
    HardBrake,
    LaneChange,
    LaneMotion,
    PathMotion,
    PositionTrigger,
    TimeTrigger,
)


class ScriptPhase(Enum):
    """Phase of an actor's script."""

    WAITING = auto()
    """It stands until the trigger fires."""
    BEFORE = auto()
    """It moves, and its action has not begun."""
    BRAKING = auto()
    HOLDING = auto()
    AFTER = auto()
    """The action is complete, or there is none."""


@dataclass(frozen=True, slots=True)
class ScriptState:
    """State of the script of one actor."""

    phase: ScriptPhase
    triggered: bool = False
    driven_s: float = 0.0
    driven_m: float = 0.0
    hold_until_tick: int = 0
    """Tick in which holding ends."""


@dataclass(frozen=True, slots=True)
class ActorPosition:
    """Position [m] and speed [m/s] of the actor."""

    x: float
    y: float
    speed: float


def build_script_state(actor: Actor) -> ScriptState:
    """Return the state in tick 0."""
    if actor.trigger is None:
        return ScriptState(ScriptPhase.AFTER)
    return ScriptState(ScriptPhase.BEFORE if isinstance(actor.action, HardBrake | LaneChange) else ScriptPhase.WAITING)


def advance_script(state: ScriptState, actor: Actor, position: ActorPosition, frame: Frame) -> ScriptState:
    """Return the state one tick later. A trigger is latched until the actor has driven far and long enough to act."""
    triggered = state.triggered or is_triggered(actor, position, frame)
    moved = position.speed > 0.0
    state = replace(
        state,
        triggered=triggered,
        driven_s=state.driven_s + DT * moved,
        driven_m=state.driven_m + position.speed * DT,
    )
    match state.phase:
        case ScriptPhase.WAITING if triggered:
            return replace(state, phase=ScriptPhase.AFTER)
        case ScriptPhase.BEFORE if triggered and _has_driven_enough(state, actor):
            return replace(
                state, phase=ScriptPhase.BRAKING if isinstance(actor.action, HardBrake) else ScriptPhase.AFTER
            )
        case ScriptPhase.BRAKING if not moved:
            return replace(state, phase=ScriptPhase.HOLDING, hold_until_tick=frame.tick + _compute_hold_ticks(actor))
        case ScriptPhase.HOLDING if frame.tick >= state.hold_until_tick:
            return replace(state, phase=ScriptPhase.AFTER)
        case _:
            return state


def _has_driven_enough(state: ScriptState, actor: Actor) -> bool:
    action = actor.action
    assert isinstance(action, HardBrake | LaneChange)
    return state.driven_s >= action.least_driven_s - 1e-9 and state.driven_m >= action.least_driven_m - 1e-9


def _compute_hold_ticks(actor: Actor) -> int:
    assert isinstance(actor.action, HardBrake)
    return round(actor.action.hold_s * TICKS_PER_SECOND)


def is_triggered(actor: Actor, position: ActorPosition, frame: Frame) -> bool:
    """Return whether the trigger's condition holds in this frame. A CAV that has ended triggers nothing."""
    match actor.trigger:
        case TimeTrigger(at_s=at_s):
            return frame.tick * DT >= at_s - 1e-9
        case DistanceTrigger(vehicle=vehicle, distance_m=reach):
            ego = frame.egos.get(vehicle)
            return ego is not None and _compute_distance(position, ego) <= reach
        case PositionTrigger(vehicle=vehicle, x=x, y=y, radius_m=radius):
            ego = frame.egos.get(vehicle)
            return ego is not None and portable.hypot(ego.x - x, ego.y - y) <= radius
        case GapTrigger(after_s=after_s):
            return frame.tick * DT >= after_s - 1e-9 and is_gap(actor, frame)
        case None:
            return False


def compute_target_speed(state: ScriptState, actor: Actor, position: ActorPosition, frame: Frame) -> float:
    """Return the speed [m/s] that the script sets. A replay has its own speed: infinite unless it must stand."""
    motion = actor.motion
    cruise = motion.speed if isinstance(motion, PathMotion | LaneMotion) else math.inf
    match state.phase:
        case ScriptPhase.WAITING | ScriptPhase.BRAKING | ScriptPhase.HOLDING:
            return 0.0
        case ScriptPhase.BEFORE:
            return compute_speed_before_trigger(actor, position, frame, cruise)
        case ScriptPhase.AFTER:
            after = actor.action.resume_speed if isinstance(actor.action, HardBrake) else None
            return cruise if after is None else after


def compute_speed_before_trigger(actor: Actor, position: ActorPosition, frame: Frame, cruise: float) -> float:
    """Return the speed [m/s] before the trigger: the cruising speed unless the actor paces a CAV that has not ended."""
    trigger, action = actor.trigger, actor.action
    if not isinstance(trigger, DistanceTrigger) or not isinstance(action, HardBrake | LaneChange) or not action.pacing:
        return cruise
    ego = frame.egos.get(trigger.vehicle)
    if ego is None:
        return cruise
    return compute_paced_speed(ego.speed, _compute_distance(position, ego), trigger.distance_m, cruise)


def find_initial_speed(actor: Actor, cav_positions: Mapping[str, tuple[float, float]]) -> float:
    """Return the speed [m/s] in frame 0. `cav_positions`: start positions [m] of the CAVs by id."""
    motion, trigger, action = actor.motion, actor.trigger, actor.action
    if not isinstance(motion, PathMotion | LaneMotion) or build_script_state(actor).phase is ScriptPhase.WAITING:
        return 0.0
    if isinstance(trigger, DistanceTrigger) and isinstance(action, HardBrake | LaneChange) and action.pacing:
        x, y = cav_positions[trigger.vehicle]
        distance = portable.hypot(x - actor.start.x, y - actor.start.y)
        return compute_initial_speed(distance, trigger.distance_m, motion.speed)
    return motion.start_speed


def _compute_distance(position: ActorPosition, ego: EgoState) -> float:
    return portable.hypot(ego.x - position.x, ego.y - position.y)


@dataclass(frozen=True, slots=True)
class PacingParams:
    """The numbers of the original code (protocol 3.4)."""

    ego_standstill_speed: float = 0.1
    """[m/s] The actor stands while the CAV is slower than this."""
    min_speed: float = 1.0
    """[m/s] Least speed far from the trigger distance; it grows by `near_speed_gain` towards it."""
    near_speed_gain: float = 2.0
    near_gap_m: float = 25.0
    """The gain acts within this distance of the trigger distance."""
    gap_time_s: float = 10.0
    """A gap is closed within about this time."""
    ego_speed_share: float = 0.98
    """Greatest speed as a share of the CAV's speed."""
    initial_near_m: float = 12.0
    """Up to this distance (or `trigger_margin_m` beyond the trigger distance) the initial speed is the target speed."""
    trigger_margin_m: float = 4.0
    initial_far_m: float = 60.0
    """From this distance on (or `ramp_m` beyond the near distance) the initial speed is `initial_far_speed`."""
    ramp_m: float = 30.0
    initial_far_speed: float = 2.0
    """[m/s]"""


PARAMS = PacingParams()


def compute_paced_speed(ego_speed: float, distance: float, trigger_m: float, target: float) -> float:
    """Return the desired speed [m/s] of an actor whose trigger fires at `trigger_m` from a CAV `distance` [m] away.

    `target`: cruising speed [m/s] of the actor.
    """
    if ego_speed < PARAMS.ego_standstill_speed:
        return 0.0
    gap = max(distance - trigger_m, 0.0)
    least = PARAMS.min_speed + PARAMS.near_speed_gain * (1.0 - min(1.0, gap / PARAMS.near_gap_m))
    return min(max(ego_speed - gap / PARAMS.gap_time_s, least), target, PARAMS.ego_speed_share * ego_speed)


def compute_initial_speed(distance: float, trigger_m: float, target: float) -> float:
    """Return the initial speed [m/s]: `target` near the CAV, 2 m/s far from it, linear in between."""
    near_m = max(PARAMS.initial_near_m, trigger_m + PARAMS.trigger_margin_m)
    far_m = max(PARAMS.initial_far_m, near_m + PARAMS.ramp_m)
    share = min(max((distance - near_m) / (far_m - near_m), 0.0), 1.0)
    return target + share * (min(PARAMS.initial_far_speed, target) - target)
