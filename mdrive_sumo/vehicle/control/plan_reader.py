"""Common to all controllers: reading a plan that may be old, short, repetitive or behind the car."""

from typing import Protocol

import numpy as np

from mdrive_sumo.contract import CONTROL_STEP, Control, OwnState, Plan
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, EgoState

OwnMotion = EgoState | OwnState
"""Both have x, y, yaw and speed."""

NEAR = 0.5
"""A goal closer than this [m] has no useful direction."""


class Controller(Protocol):
    """Follows one CAV's plans through one episode."""

    def follow(self, plan: Plan, own: OwnMotion, age_ticks: int) -> Control:
        """Return the control of this tick. The plan was built `age_ticks` ago (0: now); it may be valid for many ticks.

        A plan with an overdue last point means standing at that point.
        """
        ...


@twin
def round_control(throttle: float, brake: float, steer: float, /) -> Control:
    """Return a control within its limits, rounded to `CONTROL_STEP` as the contract stores it."""
    return Control(_round_to_step(throttle, 0.0), _round_to_step(brake, 0.0), _round_to_step(steer, -1.0))


def _round_to_step(value: float, low: float) -> float:
    return round(round(max(low, min(1.0, value)) / CONTROL_STEP) * CONTROL_STEP, 4)


def find_remaining_points(plan: Plan, own: OwnMotion, age_ticks: int) -> tuple[Float, Float]:
    """Times (K,) [s] from now and points (K, 2) [m, ego frame: x ahead, y left] that are left; the car comes first.

    Of an overdue plan its last point is left, K = 2, due at once.
    """
    due = plan.interval_s * np.arange(1, len(plan.points) + 1) - age_ticks * DT
    first = min(int(np.searchsorted(due, 1e-9, side="right")), len(due) - 1)
    times = np.concatenate(((0.0,), np.maximum(due[first:], 0.0)))
    return times, np.vstack(((0.0, 0.0), to_ego_frame(plan.points[first:], own)))


def to_ego_frame(points: Float, own: OwnMotion) -> Float:
    """Return world points (N, 2) [m] in the ego frame: x ahead, y left of the box centre."""
    cos, sin = portable.cos_sin(own.yaw)
    x, y = points[:, 0] - own.x, points[:, 1] - own.y
    return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)


def point_to_ego_frame(x: float, y: float, own: OwnMotion) -> tuple[float, float]:
    """As `to_ego_frame` for one point [m], without the overhead of an array."""
    cos, sin = portable.cos_sin(own.yaw)
    dx, dy = x - own.x, y - own.y
    return cos * dx + sin * dy, cos * dy - sin * dx


@twin
def sample_waypoints(plan: Plan, own: OwnMotion, age_ticks: int, spacing_s: float, count: int, /) -> Float:
    """Points (count, 2) [m, ego frame] where the plan wants the car after 1, 2, ... times `spacing_s` from now.

    A plan that ends earlier goes on with its last velocity; an overdue one stands at its last point.
    """
    times, points = find_remaining_points(plan, own, age_ticks)
    wanted = spacing_s * np.arange(1, count + 1)
    if times[-1] <= 0.0:
        return np.repeat(points[-1:], count, axis=0)
    velocity = (points[-1] - points[-2]) / (times[-1] - times[-2])
    over = np.maximum(wanted - times[-1], 0.0)
    return np.column_stack([np.interp(wanted, times, points[:, k]) + over * velocity[k] for k in (0, 1)])


@twin
def find_aim_point(plan: Plan, own: OwnMotion, age_ticks: int, distance: float, /) -> tuple[float, float]:
    """The point [m, ego frame] that lies `distance` ahead along what is left of the plan, prolonged straight.

    Straight ahead if the rest of the plan is shorter than `NEAR`.
    """
    _, points = find_remaining_points(plan, own, age_ticks)
    hops = portable.hypot(*np.diff(points, axis=0).T)
    kept = np.concatenate(((True,), hops > 1e-6))
    points, along = points[kept], np.concatenate(((0.0,), np.cumsum(hops[kept[1:]])))
    if along[-1] < NEAR:
        return distance, 0.0
    direction = (points[-1] - points[-2]) / (along[-1] - along[-2])
    over = max(0.0, distance - float(along[-1]))
    x, y = (float(np.interp(distance, along, points[:, k]) + over * direction[k]) for k in (0, 1))
    return x, y
