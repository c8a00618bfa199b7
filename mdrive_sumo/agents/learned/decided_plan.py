"""DecidedPlan: a plan that is kept for several ticks, told as a plan that begins now."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S
from mdrive_sumo.core.geometry import Float


@dataclass(frozen=True, slots=True)
class DecidedPlan:
    """What a network decided: a plan in the world frame, and the control of its control branch if it has one."""

    tick: int
    points: Float
    """(1 + N, 2) [m]: where the car was, and where it shall be every `PLAN_INTERVAL_S`."""
    control: Float | None = None
    """(3,) throttle, brake, steer."""
    is_creeping: bool = False
    """Whether the plan is that of `CreepRule` instead of the network's."""

    def sample(self, elapsed_s: float) -> Float:
        """Return the points (N, 2) [m, world frame] every `PLAN_INTERVAL_S` from `elapsed_s` after the decision on.

        Points between the plan's lie on straight lines; the last ones go on with the plan's last velocity. The first
        point of a `Plan` lies one interval after the present, so a plan that is repeated unchanged would stand still.
        """
        planned = PLAN_INTERVAL_S * np.arange(len(self.points))
        wanted = planned[1:] + elapsed_s
        over_s = np.maximum(wanted - planned[-1], 0.0)
        velocity = (self.points[-1] - self.points[-2]) / PLAN_INTERVAL_S
        columns = [np.interp(wanted, planned, self.points[:, axis]) + over_s * velocity[axis] for axis in (0, 1)]
        return np.column_stack(columns)
