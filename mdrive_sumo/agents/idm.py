"""`idm`: a careful driver who is alone."""

import math

import numpy as np

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.planning import right_of_way
from mdrive_sumo.planning.reference_path import SPACING_M, PathFollower, build_path, compute_curve_speeds
from mdrive_sumo.planning.stop_lines import StopLines

OPTIONS = {
    "speed": Option(8.0, 1.0, 30.0),
    "time_gap": Option(1.0, 0.2, 5.0),
    "range": Option(60.0, 5.0, 200.0),
}
ACCELERATION = 2.0
BRAKING = 2.5
"""Comfortable [m/s2]."""
HARD_BRAKING = 6.0
STOP_BRAKING = 2.0
RESPONSE_S = 0.5
"""How fast it goes up to the speed from which it could just stop comfortably."""
STANDING_GAP_M = 2.0
LATERAL = 2.5
DECIDE_TICKS = 4
"""Decides at 5 Hz, as the paper's planners do, and holds its acceleration in between."""
CROSSING_MARGIN_M = 2.0
PATIENCE_S = (2.0, 8.0)
"""Who has stood so long for others (everyone draws its own patience) insists on its turn for `BOLD_S`: four polite
drivers would wait for each other for ever."""
BOLD_S = 3.0


class IdmAgent:
    """Drives alone and by sight: keeps distance (IDM), stops at signs and red lights, yields by time-to-conflict.

    Intelligent Driver Model: Treiber, Hennecke, Helbing, Congested traffic states in empirical observations and
    microscopic simulations, Phys. Rev. E 62 (2000) 1805. It knows no intentions: whoever will turn is expected to go
    straight on until he does.
    """

    label = "single"

    def __init__(self, config: Config) -> None:
        options = read_options("idm", config, OPTIONS)
        self._cruise, self._time_gap, self._range = options["speed"], options["time_gap"], options["range"]

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is near."""
        return (SensorSpec("objects", range_m=self._range),)

    def start(self, briefing: Briefing) -> None:
        """Lays the path."""
        self._me = briefing
        self._path = build_path(briefing.route_xy, briefing.vehicle.rear_to_centre)
        stations = np.arange(len(self._path.xy)) * SPACING_M
        legal = np.interp(stations, briefing.route_s, briefing.route_speed_limit)
        self._limits = np.minimum(compute_curve_speeds(self._path, self._cruise, LATERAL, BRAKING), legal)
        self._reference = PathFollower(self._path)
        self._lines = StopLines([sign.s for sign in briefing.stop_signs], briefing.traffic_lights)
        self._acceleration = 0.0
        self._waited_s = 0.0
        self._memory = right_of_way.CurvatureEstimator()
        self._given_way: frozenset[str] = frozenset()
        self._patience_s = float(np.random.default_rng(briefing.seed).uniform(*PATIENCE_S))

    def act(self, seen: Observation) -> Reply:
        """The plan that follows from the last decision."""
        self._reference.update(seen.own.x, seen.own.y, seen.own.speed)
        if seen.tick % DECIDE_TICKS == 0:
            self._acceleration = self._decide(seen)
        return Reply(plan=self._reference.advance(self._acceleration, self._limits, self._me.tick_s))

    def _decide(self, seen: Observation) -> float:
        """Acceleration [m/s2]: the least that anything asks for."""
        assert seen.objects is not None, "the objects sensor is declared"
        me = right_of_way.EgoMotion((seen.own.x, seen.own.y), self._reference.speed, self._cruise, ACCELERATION)
        ahead = right_of_way.preview_path(self._path, self._reference.s, self._me.vehicle)
        curvature = self._memory.update(seen.objects, DECIDE_TICKS * self._me.tick_s)
        wishes = [
            self._free(),
            self._yielding(me, right_of_way.find_crossing_conflicts(ahead, seen.objects, curvature)),
        ]
        wishes += [self._behind(leader) for leader in right_of_way.find_lead_objects(me, ahead, seen.objects)]
        wishes += [self._stopping(line) for line in self._line_gaps(seen)]
        return max(min(wishes), -HARD_BRAKING)

    def _free(self) -> float:
        return ACCELERATION * (1 - (self._reference.speed / self._cruise) ** 4)

    def _behind(self, leader: right_of_way.LeadObject) -> float:
        """IDM's acceleration behind a leader."""
        speed = self._reference.speed
        closing = speed * (speed - leader.speed) / (2 * math.sqrt(ACCELERATION * BRAKING))
        wanted = STANDING_GAP_M + max(0.0, speed * self._time_gap + closing)
        return self._free() - ACCELERATION * (wanted / max(leader.gap_m, 0.1)) ** 2

    def _stopping(self, gap: float) -> float:
        """Acceleration that ends within that distance [m]: as hard as needed once comfortable braking is due."""
        speed = self._reference.speed
        if gap < 0.1:
            return -HARD_BRAKING
        allowed = math.sqrt(2 * STOP_BRAKING * gap)
        return -(speed**2) / (2 * gap) if speed > allowed else (allowed - speed) / RESPONSE_S

    def _line_gaps(self, seen: Observation) -> list[float]:
        """Distances [m] to where signs and lights want the box centre to stop."""
        s = self._reference.s
        lines = self._lines.find_stop_stations(
            self._reference.actual_s, seen.own.speed, seen.signals, lambda line: line > s and self._can_stop(line - s)
        )
        return [line - s for line in lines]

    def _can_stop(self, gap: float) -> bool:
        return self._reference.speed**2 / (2 * max(gap, 0.5)) < HARD_BRAKING

    def _yielding(self, me: right_of_way.EgoMotion, crossings: list[right_of_way.CrossingConflict]) -> float:
        """What those who cross first ask for: to wait before the first crossing at which one can still stop."""
        bold = self._waited_s > self._patience_s
        others = [c for c in crossings if c.begin_m > 0 and self._can_stop(c.begin_m - CROSSING_MARGIN_M)]
        first = [c.id for c in others if right_of_way.must_yield(me, c, c.id in self._given_way, bold)]
        self._given_way = frozenset(first)
        self._wait(bool(first) and me.speed < right_of_way.MOVING_SPEED, bold)
        if not first:
            return math.inf
        return self._stopping(min(other.begin_m for other in others) - CROSSING_MARGIN_M)

    def _wait(self, waiting: bool, bold: bool) -> None:
        """Counts how long I have stood for others, and how long I have been bold."""
        if waiting or bold:
            self._waited_s += DECIDE_TICKS * self._me.tick_s
        if self._waited_s > self._patience_s + BOLD_S:
            self._waited_s = 0.0
