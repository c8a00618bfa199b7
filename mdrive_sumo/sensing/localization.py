"""Estimated own states: what a CAV's satellite receiver, inertial unit and odometry take its state to be.

A surrogate: no receiver is simulated. Errors of position and heading are first-order Gauss-Markov processes, because
those of satellite positioning are strongly correlated in time; errors of speed and yaw rate are white.
"""

import math
from dataclasses import dataclass

from mdrive_sumo.contract import OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.seeding import draw_normals
from mdrive_sumo.core.state import DT, EgoState


@dataclass(frozen=True, slots=True)
class LocalizationParameters:
    """Errors of estimated own states; standard deviations of Gaussian errors. docs/sensors.md discusses the sources."""

    position_sigma: float = 0.2
    """[m] of x and of y. Noisy setting of V2X-ViT (Xu et al., ECCV 2022): `xyz_std`, `ryp_std` of its configuration."""
    yaw_sigma: float = math.radians(0.2)
    """[rad] The same source."""
    correlation_s: float = 30.0
    """[s] Time constant of both errors: an assumption. Martin et al., Sensors 20 (2020) 6050, find that a process of
    this kind describes the errors of civil receivers and white noise does not."""
    speed_share: float = 0.01
    """Error of the speed as a share of the speed: odometry, whose wheels stand when the car does. An assumption; at
    8 m/s the error is 0.08 m/s, where SAE J2945/1 asks for at most 0.28 m/s."""
    yaw_rate_sigma: float = math.radians(0.1)
    """[rad/s] An assumption: the order of automotive MEMS gyroscopes."""


REALISTIC_LOCALIZATION = LocalizationParameters()


class OwnStateEstimator:
    """Estimates the state of one CAV. Errors depend on (seed, tick) only, whichever ticks are asked for, and in which
    order."""

    def __init__(self, seed: int, parameters: LocalizationParameters = REALISTIC_LOCALIZATION) -> None:
        """seed: the CAV's own."""
        self._seed, self._parameters = seed, parameters
        self._kept = portable.exp(-DT / parameters.correlation_s)
        self._errors: list[tuple[float, float, float, float, float]] = []
        """By tick: x, y and yaw in standard deviations, and the tick's draws for speed and yaw rate. A pure cache."""

    def estimate(self, tick: int, truth: EgoState) -> EgoState:
        """Return the estimate of a state in that tick; acceleration and steering angle are exact."""
        x, y, yaw, speed, yaw_rate = self._find_errors(tick)
        parameters = self._parameters
        return EgoState(
            truth.x + parameters.position_sigma * x,
            truth.y + parameters.position_sigma * y,
            truth.yaw + parameters.yaw_sigma * yaw,
            truth.speed * (1 + parameters.speed_share * speed),
            truth.acceleration,
            truth.yaw_rate + parameters.yaw_rate_sigma * yaw_rate,
            truth.steer_angle,
        )

    def _find_errors(self, tick: int) -> tuple[float, float, float, float, float]:
        """Return the errors of a tick. The process starts in its stationary distribution."""
        fresh = math.sqrt(1 - self._kept * self._kept)
        while len(self._errors) <= tick:
            x, y, yaw, speed, yaw_rate, *_ = draw_normals(self._seed, "own-state", len(self._errors))
            if self._errors:
                last_x, last_y, last_yaw, *_ = self._errors[-1]
                x, y, yaw = (
                    self._kept * last + fresh * drawn for last, drawn in ((last_x, x), (last_y, y), (last_yaw, yaw))
                )
            self._errors.append((x, y, yaw, speed, yaw_rate))
        return self._errors[tick]

    def describe(self, estimate: EgoState) -> OwnState:
        """Return an estimate with its standard deviations, as the agent gets it."""
        parameters = self._parameters
        return OwnState(
            estimate.x,
            estimate.y,
            estimate.yaw,
            estimate.speed,
            estimate.acceleration,
            estimate.yaw_rate,
            estimate.steer_angle,
            position_sigma=parameters.position_sigma,
            yaw_sigma=parameters.yaw_sigma,
            speed_sigma=parameters.speed_share * abs(estimate.speed),
        )


def to_own_state(ego: EgoState) -> OwnState:
    """Return the state of an ego as exact measurements."""
    return OwnState(ego.x, ego.y, ego.yaw, ego.speed, ego.acceleration, ego.yaw_rate, ego.steer_angle)
