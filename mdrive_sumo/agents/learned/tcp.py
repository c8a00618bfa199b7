"""`tcp`: counterpart of TCP."""

import math
from collections import deque
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_ego
from mdrive_sumo.agents.learned.learned_agent import OPTIONS, DecidedPlan, LearnedAgent
from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S
from mdrive_sumo.contract import Briefing, Control, Observation, Reply
from mdrive_sumo.contract.agent_options import Option
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.window_pid import WindowPid

OTHER_WEIGHT = 0.3
"""Weight of the branch that does not lead."""
STEERS, STEERED, MOST_STEERS = 20, 0.1, 10
"""A car turns if more than 10 of its last 20 steers exceed 0.1: then the control branch leads, else the plan."""
WAYPOINTS = 4
"""Of the plan, the next 2 s: TCP predicts no more."""
AIM_M = 4.0
"""The PID steers to the waypoint that lies about so far away."""
BRAKE_SPEED = 0.4
"""[m/s] Below this planned speed the PID brakes."""
BRAKE_RATIO, MOST_ERROR, MOST_THROTTLE = 1.1, 0.25, 0.75
RIGHT_ANGLE = math.pi / 2


class ControlFusion:
    """Blends one car's branches, tick by tick."""

    def __init__(self) -> None:
        self._turn = WindowPid((0.75, 0.75, 0.3), 40)
        self._speed = WindowPid((5.0, 0.5, 1.0), 40)
        self._steers = deque([0.0] * STEERS, maxlen=STEERS)

    def blend(self, points: Float, branch: Float | None, speed: float) -> Control:
        """Return the control of this tick.

        points: (N, 2) [m, ego frame] of the plan, every `PLAN_INTERVAL_S` from now on. branch: throttle, brake, steer
        (3,) of the control branch; None: the plan alone is followed. speed: of the car [m/s].
        """
        followed = self._follow(points, speed)
        if branch is None:
            blended = followed
        else:
            turns = sum(steer > STEERED for steer in self._steers) > MOST_STEERS
            share = 1.0 - OTHER_WEIGHT if turns else OTHER_WEIGHT
            blended = share * branch + (1.0 - share) * followed
        throttle, brake, steer = blended.tolist()
        control = Control(
            throttle=0.0 if brake > 0.5 else min(max(throttle, 0.0), MOST_THROTTLE),
            brake=min(max(brake, 0.0), 1.0),
            steer=min(max(steer, -1.0), 1.0),
        )
        self._steers.append(abs(control.steer))
        return control

    def _follow(self, points: Float, speed: float) -> Float:
        """Return throttle, brake and steer (3,) of the PID that follows the plan."""
        points = points[:WAYPOINTS]
        desired = float(portable.hypot(*np.diff(points, axis=0).T).mean()) / PLAN_INTERVAL_S
        middles = (points[1:] + points[:-1]) / 2
        x, y = points[np.argmin(np.abs(portable.hypot(*middles.T) - AIM_M))].tolist()
        steer = self._turn(portable.atan2(y, x) / RIGHT_ANGLE if speed >= 0.01 else 0.0)
        brakes = desired < BRAKE_SPEED or speed > BRAKE_RATIO * desired
        throttle = self._speed(min(max(desired - speed, 0.0), MOST_ERROR))
        throttle = 0.0 if brakes else min(max(throttle, 0.0), MOST_THROTTLE)
        return np.array((throttle, float(brakes), min(max(steer, -1.0), 1.0)))


class TcpAgent(LearnedAgent):
    """Counterpart of TCP, trained on mdrive-sumo data: one front camera, answers a plan and a control and blends them.

    Option `fusion` (0: the plan alone, followed by the controller `tracker`).
    """

    system = "tcp"
    options: ClassVar[Mapping[str, Option]] = MappingProxyType({**OPTIONS, "fusion": Option(1, 0, 1, is_switch=True)})

    def start(self, briefing: Briefing) -> None:
        """Prepare the blend besides."""
        super().start(briefing)
        self._fusion = ControlFusion()

    def _build_reply(self, seen: Observation, decided: DecidedPlan) -> Reply:
        if not self._numbers["fusion"]:
            return super()._build_reply(seen, decided)
        points = convert_to_ego(self._sample_plan(seen, decided), seen.own)
        return Reply(control=self._fusion.blend(points, decided.control, seen.own.speed))
