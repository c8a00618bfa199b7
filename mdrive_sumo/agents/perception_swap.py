"""`perception-swap:*`: the paper's rule planner behind cooperative detectors, which are surrogates here."""

import math

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState, Plan, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, read_options
from mdrive_sumo.contract.detector_profiles import PROFILES
from mdrive_sumo.perception.late_fusion import FusionLimits, LateFusion
from mdrive_sumo.planning.reference_path import ReferencePath, build_path
from mdrive_sumo.planning.stop_lines import StopLines, build_stop_lines
from mdrive_sumo.v2x.awareness_service import AwarenessService
from mdrive_sumo.v2x.messages import CPM

RANGE_M = 80.0
COOPERATORS = 4
"""A detector fuses the nearest four others at most,"""
NEAR_M = 70.0
"""and nobody farther away than that (OPV2V's setting)."""
SPEED = 6.0
"""[m/s] 21.6 km/h (paper, table of controllers)."""
CONTROLLER = "carla-pid-6"
NEAREST_M, BASE_M, GROWTH_S = 0.5, 6.0, 1.0
"""A detection from so far ahead of the box centre up to `BASE_M` plus `GROWTH_S` seconds' way is a hazard,"""
ASIDE_M = 1.6 + 0.9
"""if it is no farther to the side (protocol 11.2)."""
HOLD_TICKS = 3
STANDING_SPEED, PASSABLE_M = 0.3, 4.0
"""Who stands ignores obstacles from `PASSABLE_M` on."""
INTERVAL_S = 0.2
POINTS = 15
HALT_S = 1.0


class PerceptionSwapAgent:
    """CARLA BasicAgent's hazard rule: full speed, or brakes while a detection is close ahead."""

    label = "sharing"
    detector = "ideal"

    def __init__(self, config: Config) -> None:
        read_options(f"perception-swap:{self.detector}", config, {})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes as the detector finds them."""
        return (SensorSpec("objects", range_m=RANGE_M, options={"profile": self.detector}),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._fusion = LateFusion(briefing.vehicle, FusionLimits(COOPERATORS, NEAR_M))
        self._station = AwarenessService(briefing, RANGE_M, PROFILES[self.detector].latency_ticks)
        self._way: tuple[ReferencePath, StopLines] | None = None
        self._s, self._held_until = 0.0, 0

    def act(self, seen: Observation) -> Reply:
        """On along the route, or standing."""
        assert seen.objects is not None, "the objects sensor is declared"
        path, lights = self._way = self._way or self._started(seen.own)
        self._s = path.project(seen.own.x, seen.own.y, self._s)
        notes = self._fusion.receive(message for message in seen.messages if message.type == CPM)
        if has_hazard(seen.own, self._fusion.fuse(seen.tick, seen.own, seen.objects)):
            self._held_until = seen.tick + HOLD_TICKS
        halts = seen.tick < self._held_until or self._at_red(lights, seen)
        return Reply(plan=self._plan(path, halts), messages=self._station.messages(seen), notes=notes)

    def _started(self, own: OwnState) -> tuple[ReferencePath, StopLines]:
        path = build_path(self._me.route_xy, self._me.vehicle.rear_to_centre, own.yaw)
        return path, build_stop_lines(path, self._me, signs=False)  # BasicAgent minds lights, but no stop signs

    def _at_red(self, lights: StopLines, seen: Observation) -> bool:
        ahead = lights.find_stop_stations(self._s, seen.own.speed, seen.signals, lambda line: line > self._s)
        return any(line - self._s < compute_hazard_range(seen.own.speed) for line in ahead)

    def _plan(self, path: ReferencePath, halts: bool) -> Plan:
        """Full speed along the path; who halts stands for the second that the controller looks ahead."""
        after = np.arange(1, POINTS + 1, dtype=np.float64) * INTERVAL_S
        stations = self._s + SPEED * np.maximum(after - HALT_S, 0.0) if halts else self._s + SPEED * after
        return Plan(path.get_points(stations), INTERVAL_S, CONTROLLER)


def compute_hazard_range(speed: float) -> float:
    """How far ahead [m] of the box centre a detection is a hazard, at that speed [m/s]."""
    return BASE_M + max(speed, 0.0) * GROWTH_S


def has_hazard(own: OwnState, objects: Objects) -> bool:
    """Whether the centre of a detection is in the lane-wide box straight ahead (protocol 11.2)."""
    dx, dy = objects.x - own.x, objects.y - own.y
    ahead = math.cos(own.yaw) * dx + math.sin(own.yaw) * dy
    aside = math.cos(own.yaw) * dy - math.sin(own.yaw) * dx
    close = (ahead >= NEAREST_M) & (ahead <= compute_hazard_range(own.speed)) & (np.abs(aside) <= ASIDE_M)
    if abs(own.speed) < STANDING_SPEED:
        close &= ahead < PASSABLE_M
    return bool(close.any())


class AttFuseAgent(PerceptionSwapAgent):
    """Surrogate of the paper's rule planner with AttFuse: CARLA BasicAgent's hazard rule on detections as good."""

    detector = "attfuse"


class DiscoNetAgent(PerceptionSwapAgent):
    """Surrogate of the paper's rule planner with DiscoNet: CARLA BasicAgent's hazard rule on detections as good."""

    detector = "disconet"


class FCooperAgent(PerceptionSwapAgent):
    """Surrogate of the paper's rule planner with F-Cooper: CARLA BasicAgent's hazard rule on detections as good."""

    detector = "fcooper"


class CoBevtAgent(PerceptionSwapAgent):
    """Surrogate of the paper's rule planner with CoBEVT: CARLA BasicAgent's hazard rule on detections as good."""

    detector = "cobevt"
