"""Shadowing: a random field over the places of two antennas, the same for both directions of a pair."""

import math
from typing import Final

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Float
from mdrive_sumo.core.seeding import draw_uniforms

WAVES: Final = 32
"""Waves of a field. Its values then have an excess kurtosis of -1.5 / 32: a normal distribution to 5 %."""


def draw_waves(seed: int, purpose: str, decorrelation_m: float) -> Float:
    """Return the waves (WAVES, 5) of a field: wave vector [rad/m] over x, y of both places, and phase [rad].

    The field has unit variance over pairs of places, and the correlation exp(-(|moved a| + |moved b|) / decorrelation):
    that of 3GPP TR 36.885, A.1.4, along the path of each station, as a function of places, so that it does not depend
    on which ticks or pairs are asked for. A sum of plane waves (Cai and Giannakis, IEEE Trans. Veh. Technol. 52(6),
    2003) whose wave numbers have the spectrum of an exponential correlation in the plane. Fields of other seeds or
    purposes are independent.
    """
    drawn = [draw_uniforms(seed, "shadowing", purpose, wave) for wave in range(WAVES)]
    return np.array([_make_wave(numbers, decorrelation_m) for numbers in drawn])


def evaluate_field(waves: Float, first: Float, second: Float) -> Float:
    """Return the values (P,) of a field for pairs of places (P, 2) [m].

    A caller gives the two of a pair always in the same order (that of their names), so a pair has one value.
    """
    phases = waves[:, 4:]
    for axis, column in enumerate((*first.T, *second.T)):
        phases = phases + waves[:, axis, None] * column
    # One wave after another: a plain sum over an axis has an order of NumPy's choice.
    return np.add.accumulate(portable.cos(phases), axis=0)[-1] * math.sqrt(2.0 / len(waves))  # each: variance 1/2


def _make_wave(uniforms: tuple[float, ...], decorrelation_m: float) -> tuple[float, float, float, float, float]:
    """Return one wave: the wave number of a place is below k with probability 1 - 1 / sqrt(1 + (k decorrelation)²)."""
    vector: list[float] = []
    for luck, turn in (uniforms[0:2], uniforms[2:4]):
        number = math.sqrt(1.0 / ((1.0 - luck) * (1.0 - luck)) - 1.0) / decorrelation_m
        cos, sin = portable.cos_sin(TAU * turn)
        vector += [number * cos, number * sin]
    return (*vector, TAU * uniforms[4])  # pyright: ignore[reportReturnType] - four numbers and the phase
