"""Plans as labels: points at fixed times in the ego frame."""

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_ego, convert_to_world
from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S, PLAN_POINTS
from mdrive_sumo.contract import OwnState, Plan
from mdrive_sumo.core.geometry import Float

PLAN_TIMES_S = PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1, dtype=np.float64)
"""Times (PLAN_POINTS,) of the points of a learned plan [s]."""


def sample_plan(plan: Plan, own: OwnState, times_s: Float) -> Float:
    """Return where a plan that was made now wants the car (T, 2) [m, world] at times (T,) [s] from now.

    Between points the plan is a straight line, before the first one from the car; beyond its end the last point stays,
    as the tracker takes it.
    """
    due = np.concatenate(((0.0,), plan.interval_s * np.arange(1, len(plan.points) + 1)))
    points = np.concatenate((np.array(((own.x, own.y),)), plan.points))
    return np.stack([np.interp(times_s, due, points[:, axis]) for axis in (0, 1)], axis=-1)


def label_plan(plan: Plan, own: OwnState) -> Float:
    """Return the points (PLAN_POINTS, 2) [m] of a plan at `PLAN_TIMES_S` in the ego frame of `own`."""
    return convert_to_ego(sample_plan(plan, own, PLAN_TIMES_S), own)


def move_plan(plan: Plan, made_from: OwnState, own: OwnState) -> Plan:
    """Return the plan that lies to `own` as the given one lies to `made_from`."""
    points = convert_to_world(convert_to_ego(plan.points, made_from), own)
    return Plan(points, plan.interval_s, plan.controller)
