"""Estimated own states: what a CAV's satellite receiver, inertial unit and odometry take its state to be.

A surrogate: no receiver is simulated. Errors of position and heading are first-order Gauss-Markov processes, because
those of satellite positioning are strongly correlated in time; errors of speed and yaw rate are white.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.contract import OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
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


Errors = tuple[float, float, float, float, float]
"""Of x, y and yaw in standard deviations, and the tick's draws for speed and yaw rate."""


class OwnStateEstimator:
    """Estimates the state of one CAV. Errors depend on (seed, tick) only, whichever ticks are asked for, and in which
    order."""

    def __init__(self, seed: int, parameters: LocalizationParameters = REALISTIC_LOCALIZATION) -> None:
        """seed: the CAV's own."""
        self._seed, self._parameters = seed, parameters
        self._kept = portable.exp(-DT / parameters.correlation_s)
        self._errors: list[Errors] = []
        """By tick; a pure cache."""

    def estimate(self, tick: int, truth: EgoState) -> EgoState:
        """Return the estimate of a state in that tick; acceleration and steering angle are exact."""
        return estimate_state(self._parameters, self._seed, self._kept, self._errors, tick, truth)

    def describe(self, estimate: EgoState) -> OwnState:
        """Return an estimate with its standard deviations, as the agent gets it."""
        return describe_estimate(self._parameters, estimate)


@twin
def estimate_state(
    parameters: LocalizationParameters, seed: int, kept: float, errors: list[Errors], tick: int, truth: EgoState, /
) -> EgoState:
    """Return the estimate of a state in that tick; `errors` (by tick) grow until they have it.

    kept: share of an error that is left after a tick.
    """
    while len(errors) <= tick:
        errors.append(_draw_errors(seed, kept, errors))
    x, y, yaw, speed, yaw_rate = errors[tick]
    return EgoState(
        truth.x + parameters.position_sigma * x,
        truth.y + parameters.position_sigma * y,
        truth.yaw + parameters.yaw_sigma * yaw,
        truth.speed * (1 + parameters.speed_share * speed),
        truth.acceleration,
        truth.yaw_rate + parameters.yaw_rate_sigma * yaw_rate,
        truth.steer_angle,
    )


def _draw_errors(seed: int, kept: float, errors: Sequence[Errors]) -> Errors:
    """Return the errors of the next tick. The process starts in its stationary distribution."""
    x, y, yaw, speed, yaw_rate, *_ = draw_normals(seed, "own-state", len(errors))
    if errors:
        fresh = math.sqrt(1 - kept * kept)
        x, y, yaw = (kept * last + fresh * drawn for last, drawn in zip(errors[-1][:3], (x, y, yaw), strict=True))
    return x, y, yaw, speed, yaw_rate


@twin
def describe_estimate(parameters: LocalizationParameters, estimate: EgoState, /) -> OwnState:
    """Return an estimate with its standard deviations."""
    return replace(
        to_own_state(estimate),
        position_sigma=parameters.position_sigma,
        yaw_sigma=parameters.yaw_sigma,
        speed_sigma=parameters.speed_share * abs(estimate.speed),
    )


@twin
def to_own_state(ego: EgoState, /) -> OwnState:
    """Return the state of an ego as exact measurements."""
    return OwnState(ego.x, ego.y, ego.yaw, ego.speed, ego.acceleration, ego.yaw_rate, ego.steer_angle)
