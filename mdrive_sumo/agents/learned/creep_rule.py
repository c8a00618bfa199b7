"""CreepRule: a standing car whose network keeps it standing creeps ahead from time to time.

A rule, not learned, and named so in docs/learning.md. Imitation suffers from inertia: in the data a standing car mostly
goes on standing, so a network may never start again (Codevilla et al., Exploring the Limitations of Behavior Cloning,
ICCV 2019). Published agents creep as well (TransFuser after 55 s); here a CAV that stands for 30 s counts as blocked.
The rule looks at closed lights and at nothing else: it may push a car into a standing one at walking pace.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.navigation import Navigation
from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S, PLAN_POINTS, ROUTE_POINTS, ROUTE_STEP_M
from mdrive_sumo.contract import Briefing, Observation
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

CLOSED = ("r", "y")
"""State letters of a light at which a car waits."""


@dataclass(frozen=True, slots=True)
class CreepParameters:
    """Parameters of `CreepRule`. Design choices."""

    standing_s: float = 6.0
    """[s] A car that its network has kept standing for so long creeps."""
    duration_s: float = 1.0
    """[s] Duration of one creep."""
    speed: float = 1.5
    """[m/s] Speed along the route while it creeps."""
    light_m: float = 15.0
    """[m] It does not creep with the stop line of a closed light nearer ahead than this."""
    still_speed: float = 0.3
    """[m/s] A slower car stands: own speeds may have errors."""
    still_plan_m: float = 1.0
    """A plan that ends nearer than this is one to stand."""


CREEP = CreepParameters()


class CreepRule:
    """Watches the decisions of one car's network."""

    def __init__(self, briefing: Briefing, parameters: CreepParameters = CREEP) -> None:
        self._lights, self._tick_s, self._parameters = briefing.traffic_lights, briefing.tick_s, parameters
        self._standing_since: int | None = None
        self._creep_until = -1

    def find_creep_plan(self, plan: Float, seen: Observation, navigation: Navigation) -> Float | None:
        """Return the plan (PLAN_POINTS, 2) [m, ego frame] of a car that creeps, None if the network's plan is followed.

        plan: that of the network, same shape and frame.
        """
        parameters, tick = self._parameters, seen.tick
        if tick >= self._creep_until:
            wants_to_stand = portable.hypot(*plan[-1].tolist()) < parameters.still_plan_m
            if not (wants_to_stand and abs(seen.own.speed) < parameters.still_speed):
                self._standing_since = None
                return None
            self._standing_since = tick if self._standing_since is None else self._standing_since
            stood_s = (tick - self._standing_since) * self._tick_s
            if stood_s < parameters.standing_s or self._is_before_closed_light(seen, navigation):
                return None
            self._standing_since, self._creep_until = None, tick + round(parameters.duration_s / self._tick_s)
        stations = parameters.speed * PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1)
        known = ROUTE_STEP_M * np.arange(ROUTE_POINTS)
        return np.column_stack([np.interp(stations, known, navigation.route[:, axis]) for axis in (0, 1)])

    def _is_before_closed_light(self, seen: Observation, navigation: Navigation) -> bool:
        ahead = ((light.s - navigation.station_m, seen.signals.get(light.id)) for light in self._lights)
        return any(0.0 < gap_m < self._parameters.light_m and state in CLOSED for gap_m, state in ahead)
