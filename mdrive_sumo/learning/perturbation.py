"""Perturbations: in short bursts the car follows a plan that is not the expert's, so that recovery is in the data."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_world
from mdrive_sumo.contract import OwnState, Plan
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.learning.plan_labels import sample_plan


@dataclass(frozen=True, slots=True)
class PerturbationParameters:
    """Bursts at the rate 1. All values are design choices: a learner errs by so much before it is trained well."""

    pause_s: tuple[float, float] = (4.0, 8.0)
    """Seconds from the end of a burst to the next one, divided by the rate."""
    duration_s: tuple[float, float] = (0.6, 1.6)
    lateral_share: float = 0.65
    """Share of the bursts that shift the plan sideways; the others change its pace."""
    offset_m: tuple[float, float] = (0.4, 1.0)
    """Sideways, to either side. The car lags behind: it comes 0.3 to 0.8 m and up to 10 degrees off its path."""
    pace: tuple[float, float] = (0.4, 1.25)
    """Speed along the plan as a share of the plan's."""
    ramp: float = 0.6
    """Share of a burst after which its offset is complete."""


PERTURBATION = PerturbationParameters()


@dataclass(frozen=True, slots=True)
class PerturbationBurst:
    """One burst: from `start` until before `end`, in ticks."""

    start: int
    end: int
    offset_m: float
    """Sideways, left positive; 0: the pace changes."""
    pace: float

    def apply(self, plan: Plan, own: OwnState, tick: int) -> Plan:
        """Return the plan that the car follows instead in a tick of the burst."""
        if self.offset_m:
            ramp = PERTURBATION.ramp * (self.end - self.start)
            offset = self.offset_m * min(1.0, (tick - self.start + 1) / ramp)
            aside = convert_to_world(np.array(((0.0, offset),)), own)[0] - np.array((own.x, own.y))
            return Plan(plan.points + aside, plan.interval_s, plan.controller)
        times = self.pace * plan.interval_s * np.arange(1, len(plan.points) + 1, dtype=np.float64)
        return Plan(sample_plan(plan, own, times), plan.interval_s, plan.controller)


class PerturbationSchedule:
    """The bursts of one CAV in one episode; they depend on its seed and the rate only. Ask in the order of ticks."""

    def __init__(self, seed: int, rate: float) -> None:
        """rate: 0 for none, 1 for a burst every 4 to 8 s, 2 for twice as many."""
        self._seed, self._rate, self._number = seed, rate, 0
        self._burst = self._draw(0) if rate > 0.0 else None

    def find_burst(self, tick: int) -> PerturbationBurst | None:
        """Return the burst of a tick."""
        if self._burst is None:
            return None
        while tick >= self._burst.end:
            self._number += 1
            self._burst = self._draw(self._burst.end)
        return self._burst if tick >= self._burst.start else None

    def _draw(self, after: int) -> PerturbationBurst:
        pause, duration, kind, size, side, *_ = draw_uniforms(self._seed, "perturbation", self._number)
        start = after + round(TICKS_PER_SECOND * _scale(PERTURBATION.pause_s, pause) / self._rate)
        end = start + round(TICKS_PER_SECOND * _scale(PERTURBATION.duration_s, duration))
        if kind < PERTURBATION.lateral_share:
            offset = _scale(PERTURBATION.offset_m, size)
            return PerturbationBurst(start, end, offset if side < 0.5 else -offset, 1.0)
        return PerturbationBurst(start, end, 0.0, _scale(PERTURBATION.pace, size))


def _scale(between: tuple[float, float], share: float) -> float:
    low, high = between
    return low + share * (high - low)
