"""Tables of cosine, sine and arc tangent, computed with integers, so that every machine has the same bits.

Fixed-point numbers with `BITS` binary places; the last few are wrong by the truncation of some thousand steps, which
is far below the 53 bits of a float. The division of two integers rounds correctly, so every entry is the float nearest
to the true value.

Computing them takes 10 ms, a tenth of the start of an agent's process. So they are a file of the package, which
`python -m mdrive_sumo.core.portable_tables` writes anew and a test compares with the computed ones.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Float = npt.NDArray[np.float64]

FILE = Path(__file__).with_suffix(".f64")
"""64-bit floats, little-endian, in the order of `compute_file_values`."""
BITS = 128
"""More than twice the 53 bits of a float: the last ones may be wrong by a sum's truncations, see above."""
ONE = 1 << BITS
TURN_STEPS = 1 << 14
"""Steps of the tables of cosine and sine in a full turn; the polynomials span half a step, 0.2 mrad."""
ATAN_STEPS = 1 << 8
"""Steps of the table of the arc tangent from 0 to 1."""


class PortableTables(NamedTuple):
    """Tables and constants, as `portable` uses them."""

    steps_per_radian: float
    radians_per_step: float
    cosines: Float
    """(TURN_STEPS,) cos(2 pi i / TURN_STEPS)."""
    sines: Float
    """(TURN_STEPS,) sin(2 pi i / TURN_STEPS)."""
    arc_tangents: Float
    """(ATAN_STEPS + 1,) atan(i / ATAN_STEPS)."""


def load_tables() -> PortableTables:
    """Return the tables of the package's file. Raises OSError."""
    values = np.fromfile(FILE, "<f8").astype(np.float64, copy=False)
    return arrange_tables(values)


def compute_file_values() -> list[float]:
    """Return the two constants, cosines and sines of an eighth of a turn, and the arc tangents."""
    cosines, sines = _rotate_through_an_eighth()
    return [steps_per_radian(), radians_per_step(), *cosines, *sines, *build_arc_tangents()]


def arrange_tables(values: Float) -> PortableTables:
    """Return the tables that the values of a file stand for: an eighth of a turn is computed, the rest is symmetry."""
    eighth = TURN_STEPS // 8 + 1
    constants, cosines, sines, tangents = np.split(values, (2, 2 + eighth, 2 + 2 * eighth))
    quarter = np.concatenate((cosines, sines[-2::-1]))
    half = np.concatenate((quarter, -quarter[-2::-1]))
    turn = np.concatenate((half, half[-2:0:-1]))
    steps, radians = constants.tolist()
    return PortableTables(steps, radians, turn, np.roll(turn, TURN_STEPS // 4), tangents)


def compute_pi() -> int:
    """Return pi (Machin's formula)."""
    return 4 * (4 * _arc_tangent_of_inverse(5) - _arc_tangent_of_inverse(239))


def build_arc_tangents() -> list[float]:
    """Return atan(i / ATAN_STEPS) for i in [0, ATAN_STEPS], from the differences of neighbours."""
    angles, angle = [0.0], 0
    for i in range(1, ATAN_STEPS + 1):
        angle += _arc_tangent(ONE * ATAN_STEPS // (ATAN_STEPS * ATAN_STEPS + i * (i - 1)))
        angles.append(angle / ONE)
    return angles


def steps_per_radian() -> float:
    """Return TURN_STEPS / (2 pi), rounded once."""
    from fractions import Fraction  # only here: it loads decimal arithmetic

    return float(Fraction(TURN_STEPS * ONE, 2 * compute_pi()))


def radians_per_step() -> float:
    """Return 2 pi / TURN_STEPS, rounded once."""
    return 2 * compute_pi() / (TURN_STEPS * ONE)


def _rotate_through_an_eighth() -> tuple[list[float], list[float]]:
    """Return cosines and sines of the steps 0 to TURN_STEPS / 8."""
    step = 2 * compute_pi() // TURN_STEPS
    step_cos, step_sin = _cosine(step), _sine(step)
    cos, sin = ONE, 0
    cosines, sines = [1.0], [0.0]
    for _ in range(TURN_STEPS // 8):
        cos, sin = (cos * step_cos - sin * step_sin) >> BITS, (cos * step_sin + sin * step_cos) >> BITS
        cosines.append(cos / ONE)
        sines.append(sin / ONE)
    return cosines, sines


def _cosine(x: int) -> int:
    return _alternating_series(x * x >> BITS, ONE, 0)


def _sine(x: int) -> int:
    return _alternating_series(x * x >> BITS, x, 1)


def _alternating_series(square: int, term: int, degree: int) -> int:
    """Return term - term x² / ((degree + 1)(degree + 2)) + ...: the Taylor series of cosine or sine."""
    total, sign = 0, 1
    while term:
        total += sign * term
        term = (term * square >> BITS) // ((degree + 1) * (degree + 2))
        degree, sign = degree + 2, -sign
    return total


def _arc_tangent(x: int) -> int:
    """Return atan(x) for 0 <= x well below 1 (Gregory's series)."""
    total, power, square, degree, sign = 0, x, x * x >> BITS, 1, 1
    while power:
        total += sign * (power // degree)
        power = power * square >> BITS
        degree, sign = degree + 2, -sign
    return total


def _arc_tangent_of_inverse(n: int) -> int:
    total, power, degree, sign = 0, ONE // n, 1, 1
    while power:
        total += sign * (power // degree)
        power //= n * n
        degree, sign = degree + 2, -sign
    return total


if __name__ == "__main__":
    from mdrive_sumo.core.output_files import write_bytes  # here: a box starts sooner without it

    write_bytes(FILE, np.array(compute_file_values(), "<f8").tobytes())
