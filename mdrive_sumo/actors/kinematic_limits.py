"""How road users of each kind move and keep clear. Assumptions, with where they come from."""

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind


@dataclass(frozen=True, slots=True)
class Manner:
    """What a kind of road user does with its legs, pedals and eyes."""

    accel: float
    """[m/s2]"""
    brake: float
    """Comfortable deceleration [m/s2], from which it knows when to begin to brake."""
    full: float
    """Most deceleration [m/s2]."""
    gap: float
    """How far [m] before what is in its way it stops."""
    look: float
    """How much further than it needs to stop it looks [m]."""
    clearance: float
    """How much more than its box it sweeps to either side [m]."""
    foresight: float
    """For how long [s] a road user that it yields to is taken to go straight on."""


MANNERS = MappingProxyType(
    {
        # SUMO's passenger car accelerates at 2.6 and brakes at 4.5; full braking on dry asphalt is about 8 m/s2.
        Kind.VEHICLE: Manner(2.6, 3.0, 8.0, gap=2.0, look=2.0, clearance=0.1, foresight=1.5),
        # SUMO's bicycle: 1.2 and 3; full braking of a bicycle without going over the bars is about 5 m/s2.
        Kind.CYCLIST: Manner(1.2, 2.0, 5.0, gap=1.0, look=1.0, clearance=0.1, foresight=1.5),
        # A walker stops within a step. No foresight: people on foot do not stop for cars that merely come.
        Kind.PEDESTRIAN: Manner(1.5, 2.0, 4.0, gap=0.5, look=0.5, clearance=0.0, foresight=0.0),
        # A thing that is moved (a rolling bin): as a walker.
        Kind.STATIC: Manner(1.5, 2.0, 4.0, gap=0.5, look=0.5, clearance=0.0, foresight=0.0),
    }
)


def safe_speed(room: Float, speed: Float | float, brake: Float) -> Float:
    """Greatest speed [m/s] in the next tick from which braking at `brake` ends `room` [m] further on at `speed`.

    The safe speed of Krauss (1998), with a tick for the reaction time; 0 where there is no room left.
    """
    step = brake * DT
    square = step * step + speed * speed + 2.0 * brake * (np.maximum(room, 0.0) + speed * DT)
    return np.sqrt(square) - step
