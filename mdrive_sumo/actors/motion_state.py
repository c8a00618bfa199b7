"""How all moving road users of a cast go one tick further, as pure array arithmetic."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.actors.kinematic_limits import MANNERS, safe_speed
from mdrive_sumo.actors.path_tables import Places, Tables
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor

STANDS = 1e-3
"""Slower than this [m/s] is standing: what a recording can tell apart."""


@dataclass(frozen=True, slots=True)
class Fitness:
    """What the movers are and can do, (M,) each; see `Manner`."""

    timed: Bool
    """Replays, whose progress is their own clock [s]."""
    half_length: Float
    half_width: Float
    accel: Float
    brake: Float
    full: Float
    gap: Float
    look: Float
    clearance: Float
    foresight: Float


def fitness_of(actors: Sequence[Actor]) -> Fitness:
    """Of the movers, in their order."""
    manners = [MANNERS[KIND_BY_NAME[actor.kind]] for actor in actors]
    names = ("accel", "brake", "full", "gap", "look", "clearance", "foresight")
    return Fitness(
        np.array([actor.motion.type == "replay" for actor in actors], dtype=np.bool_),
        np.array([actor.length / 2 for actor in actors]),
        np.array([actor.width / 2 for actor in actors]),
        *(np.array([getattr(manner, name) for manner in manners]) for name in names),
    )


@dataclass(frozen=True, slots=True)
class Going:
    """Where the movers are on their courses, (M,) each."""

    progress: Float
    """Arc length [m], or the own clock of a replay [s]."""
    speed: Float
    rate: Float
    """How fast the own clock of a replay goes: 1 is as logged."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the movers are up to in this tick, (M,) each."""

    target: Float
    """Speed [m/s] by their script; infinite for a replay, which has its log's."""
    limit: Float
    """Speed [m/s] by what is in their way."""
    full_brake: Bool
    frozen: Bool
    """Stands at once: struck, or not yet triggered."""


def gone_on(going: Going, here: Places, wanted: Wanted, fitness: Fitness, tables: Tables) -> Going:
    """One tick further. `here`: where `going.progress` is."""
    timed = fitness.timed
    room = np.where(timed, np.inf, np.maximum(tables.length - here.s, 0.0))
    limit = np.minimum(wanted.limit, safe_speed(room, 0.0, fitness.brake))
    plan = np.where(timed, np.minimum(here.slope, wanted.target), wanted.target)
    easing = np.where(wanted.full_brake | timed, fitness.full, fitness.brake)
    goal = np.minimum(np.maximum(plan, going.speed - easing * DT), limit)
    speed = np.clip(goal, np.maximum(going.speed - fitness.full * DT, 0.0), going.speed + fitness.accel * DT)
    speed = np.where(speed < STANDS, 0.0, speed)
    unhindered = timed & (going.rate >= 1.0) & (limit >= plan)  # a log's own speed is taken as it is
    speed = np.where(wanted.frozen, 0.0, np.where(unhindered, plan, speed))
    rate = np.where(plan > 1e-6, np.minimum(speed / np.maximum(plan, 1e-6), 1.0), 1.0)
    rate = np.where(wanted.frozen, 0.0, rate)
    onward = np.where(timed, rate, speed) * DT
    progress = np.where(timed, going.progress + onward, np.minimum(going.progress + onward, tables.end))
    return Going(progress, speed, rate)
