"""Tables of cosine, sine and arc tangent, computed with integers, so that every machine has the same bits.

Fixed-point numbers with `BITS` binary places; the last few are wrong by the truncation of some thousand steps, which
is far below the 53 bits of a float. The division of two integers rounds correctly, so every entry is the float nearest
to the true value.
"""

from fractions import Fraction

BITS = 128
ONE = 1 << BITS
TURN_STEPS = 1 << 14
"""Steps of the tables of cosine and sine in a full turn; the polynomials span half a step, 0.2 mrad."""
ATAN_STEPS = 1 << 8
"""Steps of the table of the arc tangent from 0 to 1."""


def compute_pi() -> int:
    """Return pi (Machin's formula)."""
    return 4 * (4 * _arc_tangent_of_inverse(5) - _arc_tangent_of_inverse(239))


def build_cosines() -> list[float]:
    """Return cos(2 pi i / TURN_STEPS) for i in [0, TURN_STEPS): an eighth by rotation, the rest by symmetry."""
    cosines, sines = _rotate_through_an_eighth()
    quarter = cosines + sines[-2::-1]
    half = quarter + [-value for value in quarter[-2::-1]]
    return half + half[-2:0:-1]


def build_arc_tangents() -> list[float]:
    """Return atan(i / ATAN_STEPS) for i in [0, ATAN_STEPS], from the differences of neighbours."""
    found, angle = [0.0], 0
    for i in range(1, ATAN_STEPS + 1):
        angle += _arc_tangent(ONE * ATAN_STEPS // (ATAN_STEPS * ATAN_STEPS + i * (i - 1)))
        found.append(angle / ONE)
    return found


def steps_per_radian() -> float:
    """Return TURN_STEPS / (2 pi), rounded once."""
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
