"""What a CAV warns others of: that it stands, that it brakes as hard as it can, that it is about to collide."""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap, wrap_angles
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.v2x.content import EventCause
from mdrive_sumo.v2x.services.denm_rule import Hazard


@dataclass(frozen=True, slots=True)
class HazardParameters:
    """Parameters of `HazardDetector`."""

    standing_speed: float = 0.3
    """[m/s] A slower car stands: the estimate of the own speed errs by 0.06 m/s. Ours."""
    standing_ticks: int = 10 * TICKS_PER_SECOND
    """Standing for so long is an event, unless the car waits for a light or in a queue. Ours: longer than a car waits
    for most gaps. Series cars go by their hazard lights, which do not exist here."""
    light_ahead_m: float = 40.0
    """[m] A car this close to a closed light waits for it: a queue of five cars. Ours."""
    queue_ahead_m: float = 12.0
    """[m] A car with a standing vehicle this close ahead, between centres, waits in its queue (as `lead_m` of
    trackers), ..."""
    queue_lateral_m: float = 1.5
    """[m] ... less than half a lane aside."""
    braking: float = 6.0
    """[m/s2] Deceleration of an emergency stop (UN Regulation 13-H, 5.2.23: the emergency braking signal)."""
    braking_end: float = 2.5
    """[m/s2] It ends below this deceleration (UN Regulation 13-H, 5.2.23)."""
    braking_speed: float = 20.0 / 3.6
    """[m/s] An emergency stop begins above this speed (ETSI TS 103 759, annex D: least speed of a DENM of an electronic
    emergency brake light)."""
    risk_s: float = 1.5
    """[s] A collision nearer than this, at present motion, is a risk: the threshold of a serious conflict in towns (van
    der Horst, A time-based analysis of road user behaviour in normal and critical encounters, 1990)."""
    risk_step_s: float = 0.1
    """[s] Motion is predicted in these steps: at 14 m/s of closing speed 1.4 m, a third of a car. Ours."""
    risk_hold_ticks: int = TICKS_PER_SECOND // 2
    """A risk is over when none was found for this long: detectors miss objects for half a second."""
    risk_speed: float = 1.0
    """[m/s] Slower cars do not collide with anybody: others may hit them. Ours."""


HAZARDS = HazardParameters()
EMERGENCY_BRAKE, LONGITUDINAL, CROSSING, VULNERABLE = 1, 1, 2, 4
"""Sub cause codes of ETSI TS 102 894-2: of a dangerous situation, and (the other three) of a collision risk."""


class HazardDetector:
    """Detects the hazards of one CAV by its own state and its detections."""

    def __init__(self, briefing: Briefing, parameters: HazardParameters = HAZARDS) -> None:
        self._briefing, self._parameters = briefing, parameters
        self._stands_since: int | None = None
        self._is_braking = False
        self._risk: tuple[int, Hazard] | None = None
        """Tick and content of the last risk of a collision."""

    def detect(self, seen: Observation, confirmed: Objects) -> list[Hazard]:
        """Return the hazards of this tick, at most one of each cause.

        confirmed: detections that are no false positives.
        """
        own = seen.own
        hazards = [self._detect_standstill(seen, confirmed), self._detect_braking(own)]
        hazards.append(self._detect_risk(seen.tick, own, confirmed))
        return [hazard for hazard in hazards if hazard is not None]

    def _detect_standstill(self, seen: Observation, confirmed: Objects) -> Hazard | None:
        own, parameters = seen.own, self._parameters
        if abs(own.speed) >= parameters.standing_speed:
            self._stands_since = None
            return None
        if self._stands_since is None:
            self._stands_since = seen.tick
        if seen.tick - self._stands_since < parameters.standing_ticks:
            return None
        if self._waits_for_light(seen) or self._waits_in_queue(own, confirmed):
            return None
        return Hazard(EventCause.STATIONARY_VEHICLE, 0, own.x, own.y)

    def _waits_for_light(self, seen: Observation) -> bool:
        closed = [light for light in self._briefing.traffic_lights if seen.signals.get(light.id, "g") in "ryu"]
        if not closed:
            return False
        route = self._briefing.route_xy
        gaps = portable.square(route[:, 0] - seen.own.x) + portable.square(route[:, 1] - seen.own.y)
        own_s = float(self._briefing.route_s[int(gaps.argmin())])
        reach_m = self._briefing.vehicle.length + self._parameters.light_ahead_m
        return any(own_s <= light.s <= own_s + reach_m for light in closed)

    def _waits_in_queue(self, own: OwnState, confirmed: Objects) -> bool:
        parameters = self._parameters
        cos, sin = portable.cos_sin(own.yaw)
        dx, dy = confirmed.x - own.x, confirmed.y - own.y
        ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
        is_leader = (ahead > 0.0) & (ahead < parameters.queue_ahead_m) & (np.abs(aside) < parameters.queue_lateral_m)
        return bool((is_leader & (confirmed.kind == Kind.VEHICLE)).any())

    def _detect_braking(self, own: OwnState) -> Hazard | None:
        parameters, deceleration = self._parameters, -own.acceleration
        if self._is_braking:
            self._is_braking = deceleration >= parameters.braking_end
        else:
            self._is_braking = deceleration >= parameters.braking and own.speed > parameters.braking_speed
        if not self._is_braking:
            return None
        return Hazard(EventCause.DANGEROUS_SITUATION, EMERGENCY_BRAKE, own.x, own.y)

    def _detect_risk(self, tick: int, own: OwnState, confirmed: Objects) -> Hazard | None:
        risk = self._find_collision(own, confirmed)
        if risk is not None:
            self._risk = tick, risk
        if self._risk is None or tick - self._risk[0] > self._parameters.risk_hold_ticks:
            return None
        return self._risk[1]

    def _find_collision(self, own: OwnState, others: Objects) -> Hazard | None:
        """Return the first collision at present motion: the own car accelerates on its arc, others go straight on."""
        parameters = self._parameters
        if own.speed < parameters.risk_speed:
            return None
        reach_m = (own.speed + np.abs(others.speed)) * parameters.risk_s + self._briefing.vehicle.length
        gaps = portable.hypot(others.x - own.x, others.y - own.y) - others.length / 2
        others = others.take(gaps < reach_m)
        if not len(others.ids):
            return None
        times = np.arange(1.0, round(parameters.risk_s / parameters.risk_step_s) + 1.0) * parameters.risk_step_s
        x, y, yaw = _predict_arc(own, times)
        hits = self._find_hits(x, y, yaw, others, times)
        if not hits.any():
            return None
        step = int(hits.any(axis=1).argmax())
        row = int(hits[step].argmax())
        sub_cause = _choose_sub_cause(int(others.kind[row]), float(others.yaw[row]) - own.yaw)
        return Hazard(EventCause.COLLISION_RISK, sub_cause, float(x[step]), float(y[step]))

    def _find_hits(self, x: Float, y: Float, yaw: Float, others: Objects, times: Float) -> Bool:
        """Return whether the own box (T,) and each other box (N,) overlap, (T, N)."""
        vehicle = self._briefing.vehicle
        length, width = np.full(len(times), vehicle.length), np.full(len(times), vehicle.width)
        mine = boxes_corners(x, y, yaw, length, width)[:, None]
        cos, sin = portable.cos_sin(others.yaw)
        theirs = boxes_corners(
            others.x + others.speed * cos * times[:, None],
            others.y + others.speed * sin * times[:, None],
            others.yaw[None],
            others.length[None],
            others.width[None],
        )
        return boxes_overlap(*(np.ascontiguousarray(box) for box in np.broadcast_arrays(mine, theirs)))


def _predict_arc(own: OwnState, times: Float) -> tuple[Float, Float, Float]:
    """Return x, y [m] and yaw [rad] (T,) at present yaw rate and acceleration; a braking car stops."""
    braking_s = own.speed / -own.acceleration if own.acceleration < 0.0 else math.inf
    moving = np.minimum(times, braking_s)
    ways = own.speed * moving + own.acceleration * moving * moving / 2
    turns = own.yaw_rate * moving
    cos, sin = portable.cos_sin(own.yaw + turns / 2)  # along the chord
    return own.x + ways * cos, own.y + ways * sin, own.yaw + turns


def _choose_sub_cause(kind: int, angle: float) -> int:
    """Return the sub cause of a collision with a road user of that kind; angle [rad] between the headings."""
    if kind in (Kind.PEDESTRIAN, Kind.CYCLIST):
        return VULNERABLE
    turn = abs(float(wrap_angles(np.array((angle,)))[0]))
    return CROSSING if math.pi / 4 < turn < 3 * math.pi / 4 else LONGITUDINAL
