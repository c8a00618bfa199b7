"""Actions: what the numbers of a policy mean for the car.

- `pedals`: (2,) in [-1, 1]: throttle above 0 and brake below; steering, positive to the left.
- `speed-offset`: (2,) in [-1, 1]: target speed from 0 to `GREATEST_SPEED`; offset from the route, full scale
  `GREATEST_OFFSET_M`, positive to the left.
- `targets`: the number of one of `TARGETS`, pairs of target speed and offset.
- `anchors`: the number of one of the trajectories of `plan_anchors`, from where the car takes itself to be.

All but pedals become a plan in every tick, which the controller `tracker` follows: the first two along the route.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned import plan_anchors
from mdrive_sumo.agents.learned.ego_frame import convert_to_world
from mdrive_sumo.agents.learned.learned_agent import DecidedPlan
from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S as ANCHOR_INTERVAL_S
from mdrive_sumo.contract import Control, Observation, OwnState, Plan, Reply
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.core.state import DT
from mdrive_sumo.rl.route_cursor import RouteCursor

GREATEST_SPEED = 16.0
"""[m/s] Twice the speed that the protocol asks for."""
GREATEST_OFFSET_M = 3.5
"""A lane's width: a policy can change to the lane beside its own."""
ACCELERATION, DECELERATION = 2.5, 5.0
"""[m/s2] With which a plan reaches its target speed; the car's limits are higher. Chosen: brisk, and a firm stop."""
OFFSET_S = 2.0
"""Time [s] in which a plan reaches its offset, half that of a comfortable lane change."""
PLAN_POINTS, PLAN_INTERVAL_S = 20, 0.1
"""Of a plan: two seconds, as the trackers of the baselines look."""
TARGETS = tuple(
    (speed, offset)
    for speed in (0.0, 0.25 * PROTOCOL_SPEED, 0.5 * PROTOCOL_SPEED, PROTOCOL_SPEED, 1.5 * PROTOCOL_SPEED)
    for offset in (-GREATEST_OFFSET_M, 0.0, GREATEST_OFFSET_M)
)
"""Target speed [m/s] and offset [m] of each target."""
CHOICES = {"targets": len(TARGETS), "anchors": plan_anchors.ANCHORS}
"""Number of choices by kind of control, if an action is one of them."""
CONTROL_WIDTH = {"pedals": 2, "speed-offset": 2, "targets": 1, "anchors": 1}
"""Numbers in an action by kind of control."""

_TIMES = np.arange(1, PLAN_POINTS + 1) * PLAN_INTERVAL_S
_SHARES = np.minimum(_TIMES / OFFSET_S, 1.0)


def make_pedals(action: npt.NDArray[np.float32]) -> Reply:
    """Return the reply to an action (2,) of kind `pedals`."""
    pedal, steer = action.tolist()
    return Reply(control=Control(max(pedal, 0.0), max(-pedal, 0.0), steer))


PlanSource = Callable[[Observation], Plan]
"""Returns the plan of a tick, after an action until the next one."""


def make_plan_source(
    control: str, action: npt.NDArray[np.float32], cursor: RouteCursor, seen: Observation
) -> PlanSource:
    """Return the plans of an action of one of the other kinds. seen: what the CAV sees when it acts."""
    if control == "anchors":
        anchor = plan_anchors.build_anchors().points[int(action[0])]
        points = convert_to_world(np.concatenate((np.zeros((1, 2)), anchor)), seen.own)
        return partial(_continue_anchor, DecidedPlan(seen.tick, points, None))
    return partial(_plan_along_route, cursor, *read_target(control, action))


def read_target(control: str, action: npt.NDArray[np.float32]) -> tuple[float, float]:
    """Return target speed [m/s] and offset [m] of an action of kind `targets` or `speed-offset`."""
    if control == "targets":
        return TARGETS[int(action[0])]
    speed, offset = action.tolist()
    return (speed + 1.0) / 2.0 * GREATEST_SPEED, offset * GREATEST_OFFSET_M


def _continue_anchor(decided: DecidedPlan, seen: Observation) -> Plan:
    return Plan(decided.sample((seen.tick - decided.tick) * DT), ANCHOR_INTERVAL_S)


def _plan_along_route(cursor: RouteCursor, speed: float, offset: float, seen: Observation) -> Plan:
    return plan_along_route(cursor, seen.own, speed, offset)


def plan_along_route(cursor: RouteCursor, own: OwnState, speed: float, offset: float) -> Plan:
    """Return the plan that reaches a speed [m/s] and an offset [m] from the route."""
    place = cursor.locate(own)
    change = np.clip(speed - own.speed, -DECELERATION * _TIMES, ACCELERATION * _TIMES)
    s = place.s + np.cumsum(np.maximum(own.speed + change, 0.0)) * PLAN_INTERVAL_S
    return Plan(cursor.find_points(s, place.offset + (offset - place.offset) * _SHARES), PLAN_INTERVAL_S)
