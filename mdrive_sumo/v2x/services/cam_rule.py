"""When a station sends a CAM: the generation rules of ETSI EN 302 637-2 V1.4.1, section 6.1.3."""

from dataclasses import dataclass

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.services.motion_thresholds import (
    MAX_INTERVAL_TICKS,
    MIN_INTERVAL_TICKS,
    MOTION_THRESHOLDS,
    MotionThresholds,
)


@dataclass(frozen=True, slots=True)
class CamGeneration:
    """Parameters of `CamRule`; sections of EN 302 637-2 V1.4.1."""

    thresholds: MotionThresholds = MOTION_THRESHOLDS
    min_ticks: int = MIN_INTERVAL_TICKS
    """T_GenCamMin (6.1.3)."""
    max_ticks: int = MAX_INTERVAL_TICKS
    """T_GenCamMax (6.1.3)."""
    repetitions: int = 3
    """N_GenCam: CAMs in a row without a trigger that keep the interval of the last trigger (6.1.3)."""
    low_frequency_ticks: int = TICKS_PER_SECOND // 2
    """The low-frequency container is in the first CAM, and again after 500 ms (6.1.3)."""


CAM_GENERATION = CamGeneration()


@dataclass(frozen=True, slots=True)
class StationMotion:
    """Where a station is [m, rad], and its speed [m/s]."""

    x: float
    y: float
    yaw: float
    speed: float


@dataclass(frozen=True, slots=True)
class DueCam:
    """A CAM that is to be sent."""

    has_low_frequency: bool
    """Whether it has the low-frequency container."""


class CamRule:
    """The CAMs of one station. Ask it in every 100 ms at least (T_CheckCamGen)."""

    def __init__(self, parameters: CamGeneration = CAM_GENERATION) -> None:
        self._parameters = parameters
        self._last: tuple[int, StationMotion] | None = None
        """Tick and motion of the last CAM."""
        self._low_frequency_tick = 0
        """Tick of the last CAM with the low-frequency container."""
        self._interval_ticks = parameters.max_ticks
        """T_GenCam: when a CAM is due without a trigger."""
        self._repeated = 0
        """CAMs in a row that were due without a trigger."""

    def check(self, tick: int, motion: StationMotion, dcc_ticks: int = 0) -> DueCam | None:
        """Return the CAM that is to be sent in this tick, which then counts as sent; None if none is due.

        dcc_ticks: T_GenCam_DCC, the least interval that congestion control grants.
        """
        if self._last is None:
            return self._send(tick, motion, has_low_frequency=True)
        elapsed_ticks = tick - self._last[0]
        least_ticks = min(max(dcc_ticks, self._parameters.min_ticks), self._parameters.max_ticks)
        if elapsed_ticks < least_ticks:
            return None
        if self._has_changed(self._last[1], motion):
            self._interval_ticks, self._repeated = elapsed_ticks, 0
        elif elapsed_ticks >= self._interval_ticks:
            self._repeated += 1
            if self._repeated >= self._parameters.repetitions:
                self._interval_ticks = self._parameters.max_ticks
        else:
            return None
        is_low_due = tick - self._low_frequency_tick >= self._parameters.low_frequency_ticks
        return self._send(tick, motion, has_low_frequency=is_low_due)

    def _has_changed(self, before: StationMotion, now: StationMotion) -> bool:
        thresholds = self._parameters.thresholds
        return (
            abs(wrap_angle(now.yaw - before.yaw)) > thresholds.heading
            or portable.hypot(now.x - before.x, now.y - before.y) > thresholds.distance_m
            or abs(now.speed - before.speed) > thresholds.speed
        )

    def _send(self, tick: int, motion: StationMotion, has_low_frequency: bool) -> DueCam:
        self._last = tick, motion
        if has_low_frequency:
            self._low_frequency_tick = tick
        return DueCam(has_low_frequency)
