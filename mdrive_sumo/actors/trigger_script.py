"""What a trigger sets off, as a small state machine without side effects: one `Cue` an actor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto

from mdrive_sumo.actors.pacing import initial_speed, paced_speed
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, EgoState, Frame
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    HardBrake,
    LaneChange,
    LaneMotion,
    PathMotion,
    PositionTrigger,
    TimeTrigger,
)


class Phase(Enum):
    """Where an actor is in its script."""

    WAITING = auto()
    """Stands until it is triggered."""
    BEFORE = auto()
    """Drives, and has not done yet what its trigger sets off."""
    BRAKING = auto()
    HOLDING = auto()
    AFTER = auto()
    """Nothing is left to happen."""


@dataclass(frozen=True, slots=True)
class Cue:
    """How far the script of one actor is."""

    phase: Phase
    triggered: bool = False
    driven_s: float = 0.0
    driven_m: float = 0.0
    until: int = 0
    """Tick in which a hold ends."""


@dataclass(frozen=True, slots=True)
class Own:
    """Where the actor itself is."""

    x: float
    y: float
    speed: float


def first_cue(actor: Actor) -> Cue:
    """At the beginning."""
    if actor.trigger is None:
        return Cue(Phase.AFTER)
    return Cue(Phase.BEFORE if isinstance(actor.action, HardBrake | LaneChange) else Phase.WAITING)


def next_cue(cue: Cue, actor: Actor, own: Own, frame: Frame) -> Cue:
    """One tick on. A trigger is remembered until the actor has driven for long enough to act on it."""
    triggered = cue.triggered or fires(actor, own, frame)
    moved = own.speed > 0.0
    cue = replace(
        cue,
        triggered=triggered,
        driven_s=cue.driven_s + DT * moved,
        driven_m=cue.driven_m + own.speed * DT,
    )
    match cue.phase:
        case Phase.WAITING if triggered:
            return replace(cue, phase=Phase.AFTER)
        case Phase.BEFORE if triggered and _warmed_up(cue, actor):
            return replace(cue, phase=Phase.BRAKING if isinstance(actor.action, HardBrake) else Phase.AFTER)
        case Phase.BRAKING if not moved:
            return replace(cue, phase=Phase.HOLDING, until=frame.tick + _hold_ticks(actor))
        case Phase.HOLDING if frame.tick >= cue.until:
            return replace(cue, phase=Phase.AFTER)
        case _:
            return cue


def _warmed_up(cue: Cue, actor: Actor) -> bool:
    action = actor.action
    assert isinstance(action, HardBrake | LaneChange)
    return cue.driven_s >= action.least_driven_s - 1e-9 and cue.driven_m >= action.least_driven_m - 1e-9


def _hold_ticks(actor: Actor) -> int:
    assert isinstance(actor.action, HardBrake)
    return round(actor.action.hold_s * TICKS_PER_SECOND)


def fires(actor: Actor, own: Own, frame: Frame) -> bool:
    """Whether the trigger's condition holds in this frame. A CAV that has ended triggers nothing."""
    match actor.trigger:
        case TimeTrigger(at_s=at_s):
            return frame.tick * DT >= at_s - 1e-9
        case DistanceTrigger(vehicle=vehicle, distance_m=reach):
            ego = frame.egos.get(vehicle)
            return ego is not None and _distance(own, ego) <= reach
        case PositionTrigger(vehicle=vehicle, x=x, y=y, radius_m=radius):
            ego = frame.egos.get(vehicle)
            return ego is not None and math.hypot(ego.x - x, ego.y - y) <= radius
        case None:
            return False


def target_speed(cue: Cue, actor: Actor, own: Own, frame: Frame) -> float:
    """Speed [m/s] that the script wants; of a replay, which has its own: infinite unless it shall stand."""
    motion = actor.motion
    cruise = motion.speed if isinstance(motion, PathMotion | LaneMotion) else math.inf
    match cue.phase:
        case Phase.WAITING | Phase.BRAKING | Phase.HOLDING:
            return 0.0
        case Phase.BEFORE:
            return paced(actor, own, frame, cruise)
        case Phase.AFTER:
            after = actor.action.resume_speed if isinstance(actor.action, HardBrake) else None
            return cruise if after is None else after


def paced(actor: Actor, own: Own, frame: Frame, cruise: float) -> float:
    """Speed before the trigger; the cruising speed unless the actor paces a CAV that is still there."""
    trigger, action = actor.trigger, actor.action
    if not isinstance(trigger, DistanceTrigger) or not isinstance(action, HardBrake | LaneChange) or not action.pacing:
        return cruise
    ego = frame.egos.get(trigger.vehicle)
    if ego is None:
        return cruise
    return paced_speed(ego.speed, _distance(own, ego), trigger.distance_m, cruise)


def initial_speed_of(actor: Actor, cavs: Mapping[str, tuple[float, float]]) -> float:
    """Speed [m/s] in frame 0. `cavs`: where the CAVs start [m]."""
    motion, trigger, action = actor.motion, actor.trigger, actor.action
    if not isinstance(motion, PathMotion | LaneMotion) or first_cue(actor).phase is Phase.WAITING:
        return 0.0
    if isinstance(trigger, DistanceTrigger) and isinstance(action, HardBrake | LaneChange) and action.pacing:
        x, y = cavs[trigger.vehicle]
        distance = math.hypot(x - actor.start.x, y - actor.start.y)
        return initial_speed(distance, trigger.distance_m, motion.speed)
    return motion.start_speed


def _distance(own: Own, ego: EgoState) -> float:
    return math.hypot(ego.x - own.x, ego.y - own.y)
