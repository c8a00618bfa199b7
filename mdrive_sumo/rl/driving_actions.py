"""Actions: what the numbers of a policy mean for the car.

- `pedals`: (2,) in [-1, 1]: throttle above 0 and brake below; steering, positive to the left.
- `speed-offset`: (2,) in [-1, 1]: target speed from 0 to `GREATEST_SPEED`; offset from the route, full scale
  `GREATEST_OFFSET_M`, positive to the left.
- `anchors`: the number of one of `ANCHORS`, pairs of target speed and offset.

The last two become a plan along the route in every tick, which the controller `tracker` follows.
"""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Control, OwnState, Plan, Reply
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
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
ANCHORS = tuple(
    (speed, offset)
    for speed in (0.0, 0.25 * PROTOCOL_SPEED, 0.5 * PROTOCOL_SPEED, PROTOCOL_SPEED, 1.5 * PROTOCOL_SPEED)
    for offset in (-GREATEST_OFFSET_M, 0.0, GREATEST_OFFSET_M)
)
"""Target speed [m/s] and offset [m] of each anchor."""
CONTROL_WIDTH = {"pedals": 2, "speed-offset": 2, "anchors": 1}
"""Numbers in an action by kind of control."""

_TIMES = np.arange(1, PLAN_POINTS + 1) * PLAN_INTERVAL_S
_SHARES = np.minimum(_TIMES / OFFSET_S, 1.0)


def make_pedals(action: npt.NDArray[np.float32]) -> Reply:
    """Return the reply to an action (2,) of kind `pedals`."""
    pedal, steer = action.tolist()
    return Reply(control=Control(max(pedal, 0.0), max(-pedal, 0.0), steer))


def read_target(control: str, action: npt.NDArray[np.float32]) -> tuple[float, float]:
    """Return target speed [m/s] and offset [m] of an action of one of the other kinds."""
    if control == "anchors":
        return ANCHORS[int(action[0])]
    speed, offset = action.tolist()
    return (speed + 1.0) / 2.0 * GREATEST_SPEED, offset * GREATEST_OFFSET_M


def plan_along_route(cursor: RouteCursor, own: OwnState, speed: float, offset: float) -> Plan:
    """Return the plan that reaches a speed [m/s] and an offset [m] from the route."""
    place = cursor.locate(own)
    change = np.clip(speed - own.speed, -DECELERATION * _TIMES, ACCELERATION * _TIMES)
    s = place.s + np.cumsum(np.maximum(own.speed + change, 0.0)) * PLAN_INTERVAL_S
    return Plan(cursor.find_points(s, place.offset + (offset - place.offset) * _SHARES), PLAN_INTERVAL_S)
