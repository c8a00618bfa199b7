"""`perception-swap:*`: the paper's rule planner behind a surrogate of a cooperative detector's quality on one vehicle.

The cooperative detector is not run: every CAV has detections as good as the detector's published ones, and the CAVs
exchange them as CPMs besides.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import (
    Briefing,
    Cause,
    Objects,
    Observation,
    OwnState,
    Plan,
    Reason,
    ReasonLog,
    Reply,
    SensorSpec,
)
from mdrive_sumo.contract.agent_options import Config, read_options
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.perception.late_fusion import ETSI_FUSION, FUSION, FusionLimits, LateFusion
from mdrive_sumo.planning.reference_path import ReferencePath, build_path
from mdrive_sumo.planning.stop_lines import StopLines, build_stop_lines
from mdrive_sumo.v2x.awareness_service import AwarenessService
from mdrive_sumo.v2x.messages import CPM


@dataclass(frozen=True, slots=True)
class PerceptionSwapParameters:
    """Parameters of `PerceptionSwapAgent`; the hazard rule is that of protocol 11.2 (CARLA's BasicAgent)."""

    range_m: float = 80.0
    """[m] Of the detector."""
    max_senders: int = 4
    """The detector fuses the detections of the nearest senders, at most this many (OPV2V's setting),"""
    max_sender_distance_m: float = 70.0
    """and at most this far away."""
    speed: float = 6.0
    """[m/s] 21.6 km/h (paper, table of controllers)."""
    controller: str = "carla-pid-6"
    """CARLA's PID with the gains of the paper for 6 m/s."""
    min_ahead_m: float = 0.5
    """A detection between this distance and `hazard_base_m` plus the way of `hazard_growth_s` ahead is a hazard."""
    hazard_base_m: float = 6.0
    """[m] Range of a hazard at standstill (protocol 11.2)."""
    hazard_growth_s: float = 1.0
    """[s] The range grows by the way that the car drives in this time (protocol 11.2)."""
    max_lateral_m: float = 1.6 + 0.9
    """... unless it is further to the side."""
    hold_ticks: int = 3
    """A hazard counts for this long."""
    standing_speed: float = 0.3
    """[m/s] A slower car ignores hazards from `standing_range_m` on."""
    standing_range_m: float = 4.0
    """[m] See `standing_speed`."""
    interval_s: float = 0.2
    """Spacing of plan points [s]."""
    plan_points: int = 15
    """3 s with `interval_s`."""
    halt_s: float = 1.0
    """A halting plan stands for the second that the controller looks ahead."""


PERCEPTION_SWAP = PerceptionSwapParameters()


class PerceptionSwapAgent:
    """CARLA BasicAgent's hazard rule: full speed, or brakes while a detection is close ahead."""

    label = "sharing"
    detector = "ideal"

    def __init__(self, config: Config) -> None:
        read_options(f"perception-swap:{self.detector}", config, {})

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of boxes as the detector finds them."""
        return (SensorSpec("objects", range_m=PERCEPTION_SWAP.range_m, options={"profile": self.detector}),)

    def start(self, briefing: Briefing) -> None:
        """Prepare fusion and sending; the path needs the first observation, which has the heading of the car."""
        self._briefing = briefing
        limits = FusionLimits(PERCEPTION_SWAP.max_senders, PERCEPTION_SWAP.max_sender_distance_m)
        accumulates = briefing.v2x_rate == "etsi"
        self._fusion = LateFusion(briefing.vehicle, limits, ETSI_FUSION if accumulates else FUSION, accumulates)
        self._awareness = AwarenessService(briefing, PERCEPTION_SWAP.range_m, self.detector)
        self._route: tuple[ReferencePath, StopLines] | None = None
        self._s, self._hold_until_tick = 0.0, 0
        self._reasons, self._hazard = ReasonLog(), Reason(Cause.HAZARD)

    def act(self, seen: Observation) -> Reply:
        """Return a plan that drives along the route at full speed, or stands."""
        assert seen.objects is not None, "the objects sensor is declared"
        path, lights = self._route = self._route or self._build_route(seen.own)
        self._s = path.project(seen.own.x, seen.own.y, self._s)
        notes = self._fusion.receive(message for message in seen.messages if message.type == CPM)
        objects = self._fusion.fuse(seen.tick, seen.own, seen.objects)
        hazards = find_hazards(seen.own, objects)
        if hazards.any():
            self._hold_until_tick = seen.tick + PERCEPTION_SWAP.hold_ticks
            self._hazard = _describe_hazard(seen.own, objects.take(hazards))
        reason = self._hazard if seen.tick < self._hold_until_tick else self._find_red_light(lights, seen)
        plan = self._build_plan(path, halts=reason is not None)
        notes += self._reasons.record(reason or Reason(Cause.FREE, speed=PERCEPTION_SWAP.speed))
        return Reply(plan=plan, messages=self._awareness.compose_messages(seen), notes=notes)

    def _build_route(self, own: OwnState) -> tuple[ReferencePath, StopLines]:
        """Return the path, and the traffic lights on it: BasicAgent obeys no stop signs."""
        path = build_path(self._briefing.route_xy, self._briefing.vehicle.rear_to_centre, own.yaw)
        return path, build_stop_lines(path, self._briefing, include_signs=False)

    def _find_red_light(self, lights: StopLines, seen: Observation) -> Reason | None:
        """Return the closed light within the range of a hazard as a reason, None if there is none."""
        ahead = lights.find_stops(self._s, seen.own.speed, seen.signals, lambda line: line > self._s)
        range_m = compute_hazard_range(seen.own.speed)
        return next((stop.reason for stop in ahead if stop.s - self._s < range_m), None)

    def _build_plan(self, path: ReferencePath, halts: bool) -> Plan:
        """Return full speed along the path; a halting plan stands for `halt_s` first."""
        parameters = PERCEPTION_SWAP
        after = np.arange(1, parameters.plan_points + 1, dtype=np.float64) * parameters.interval_s
        moving_s = np.maximum(after - parameters.halt_s, 0.0) if halts else after
        stations = self._s + parameters.speed * moving_s
        return Plan(path.get_points(stations), parameters.interval_s, parameters.controller)


def compute_hazard_range(speed: float) -> float:
    """Return how far ahead [m] of the box centre a detection is a hazard, at that speed [m/s]."""
    return PERCEPTION_SWAP.hazard_base_m + max(speed, 0.0) * PERCEPTION_SWAP.hazard_growth_s


def find_hazards(own: OwnState, objects: Objects) -> Bool:
    """Return a mask (N,): detections whose centre is in the lane-wide box straight ahead (protocol 11.2)."""
    parameters = PERCEPTION_SWAP
    dx, dy = objects.x - own.x, objects.y - own.y
    cos, sin = portable.cos_sin(own.yaw)
    ahead, lateral = cos * dx + sin * dy, cos * dy - sin * dx
    close = (ahead >= parameters.min_ahead_m) & (ahead <= compute_hazard_range(own.speed))
    close &= np.abs(lateral) <= parameters.max_lateral_m
    if abs(own.speed) < parameters.standing_speed:
        close &= ahead < parameters.standing_range_m
    return close


def _describe_hazard(own: OwnState, hazards: Objects) -> Reason:
    """Return the nearest hazard as a reason."""
    distances_m = portable.hypot(hazards.x - own.x, hazards.y - own.y)
    row = int(distances_m.argmin())
    position = float(hazards.x[row]), float(hazards.y[row])
    return Reason(Cause.HAZARD, (hazards.ids[row],), position, float(distances_m[row]))


class AttFuseAgent(PerceptionSwapAgent):
    """Surrogate: AttFuse's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "attfuse"


class DiscoNetAgent(PerceptionSwapAgent):
    """Surrogate: DiscoNet's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "disconet"


class FCooperAgent(PerceptionSwapAgent):
    """Surrogate: F-Cooper's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "fcooper"


class CoBevtAgent(PerceptionSwapAgent):
    """Surrogate: CoBEVT's detection quality on one vehicle, with CARLA BasicAgent's hazard rule."""

    detector = "cobevt"
