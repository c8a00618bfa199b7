"""Kinematic limits and margins of scripted actors by kind: assumptions, each with its source."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind


@dataclass(frozen=True, slots=True)
class KinematicLimits:
    """Acceleration limits and safety margins of a kind of road user."""

    accel: float
    """[m/s2]"""
    comfort_brake: float
    """Comfortable deceleration [m/s2]; it determines where braking begins."""
    max_brake: float
    """Greatest deceleration [m/s2]."""
    gap: float
    """Distance [m] to an obstacle at standstill."""
    look_margin: float
    """Distance [m] that it looks beyond its stopping distance."""
    clearance: float
    """Lateral margin [m] of the swept area on either side of the box."""
    prediction_s: float
    """Time [s] for which the straight motion of a road user with right of way is predicted."""


LIMITS_BY_KIND = MappingProxyType(
    {
        # SUMO's passenger car accelerates at 2.6 and brakes at 4.5; full braking on dry asphalt is about 8 m/s2.
        Kind.VEHICLE: KinematicLimits(2.6, 3.0, 8.0, gap=2.0, look_margin=2.0, clearance=0.1, prediction_s=1.5),
        # SUMO's bicycle: 1.2 and 3; full braking of a bicycle without going over the bars is about 5 m/s2.
        Kind.CYCLIST: KinematicLimits(1.2, 2.0, 5.0, gap=1.0, look_margin=1.0, clearance=0.1, prediction_s=1.5),
        # A pedestrian stops within a step. No prediction: pedestrians do not stop for cars that merely approach.
        Kind.PEDESTRIAN: KinematicLimits(1.5, 2.0, 4.0, gap=0.5, look_margin=0.5, clearance=0.0, prediction_s=0.0),
        # An object that is moved (a rolling bin): as a pedestrian.
        Kind.STATIC: KinematicLimits(1.5, 2.0, 4.0, gap=0.5, look_margin=0.5, clearance=0.0, prediction_s=0.0),
    }
)


def compute_safe_speed(room: Float, speed: Float | float, brake: Float) -> Float:
    """Return the greatest speed [m/s] in the next tick from which braking at `brake` ends after `room` [m] at `speed`.

    The safe speed of Krauss (1998), with one tick of reaction time; 0 where no room is left.
    """
    step = brake * DT
    square = step * step + speed * speed + 2.0 * brake * (np.maximum(room, 0.0) + speed * DT)
    return np.sqrt(square) - step
