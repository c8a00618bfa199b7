"""Portable functions: against decimal arithmetic, one formula for numbers and arrays, known bits."""

import math
from collections.abc import Callable
from decimal import Decimal, localcontext
from hashlib import blake2b

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core import portable, portable_tables
from mdrive_sumo.core.geometry import Float

ANGLES = st.floats(-20.0, 20.0)
LENGTHS = st.one_of(st.floats(-400.0, 400.0), st.floats(-1e-3, 1e-3)).filter(lambda x: x == 0 or abs(x) > 1e-100)
EXPONENTS = st.floats(-600.0, 600.0)
POSITIVE = st.one_of(st.floats(1e-200, 1e200), st.floats(0.5, 2.0))
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")
DIGITS = 60


def decimal_cos(x: Decimal) -> Decimal:
    return taylor(x, Decimal(1), 0)


def decimal_sin(x: Decimal) -> Decimal:
    return taylor(x, x, 1)


def taylor(x: Decimal, term: Decimal, degree: int) -> Decimal:
    total = term
    while abs(term) > Decimal(10) ** -DIGITS:
        term *= -x * x / ((degree + 1) * (degree + 2))
        degree += 2
        total += term
    return total


def decimal_atan2(y: float, x: float) -> Decimal:
    """Newton's method on the angle: the tangent of the error is (y cos - x sin) / (x cos + y sin)."""
    angle = Decimal(math.atan2(y, x))
    for _ in range(3):
        cos, sin = decimal_cos(angle), decimal_sin(angle)
        angle += (Decimal(y) * cos - Decimal(x) * sin) / (Decimal(x) * cos + Decimal(y) * sin)
    return angle


def ulps(found: float, truth: Decimal) -> float:
    return float(abs(Decimal(found) - truth) / Decimal(math.ulp(float(truth))))


@given(angle=ANGLES)
def test_cosine_and_sine_are_accurate(angle: float) -> None:
    with localcontext(prec=DIGITS + 20):
        bound = 2e-16 * (1 + abs(angle))
        cos, sin = portable.cos_sin(angle)
        assert abs(Decimal(cos) - decimal_cos(Decimal(angle))) <= bound
        assert abs(Decimal(sin) - decimal_sin(Decimal(angle))) <= bound
    assert portable.sin(angle) == sin == portable.sin(np.full(20, angle))[0]


@given(angle=st.floats(-1e-2, 1e-2).filter(lambda x: abs(x) > 1e-100))
def test_sines_of_small_angles_have_few_wrong_units(angle: float) -> None:
    with localcontext(prec=DIGITS + 20):
        assert ulps(portable.sin(angle), decimal_sin(Decimal(angle))) <= 4


@pytest.mark.parametrize("quarters", range(-9, 10))
def test_right_angles_are_exact(quarters: int) -> None:
    expected = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarters % 4]
    assert portable.cos_sin(quarters * math.pi / 2) == expected


@given(y=LENGTHS, x=LENGTHS)
def test_directions_are_accurate(y: float, x: float) -> None:
    found = portable.atan2(y, x)
    if y == 0:
        assert found == (math.pi if x < 0 else 0.0)
        return
    with localcontext(prec=DIGITS + 20):
        assert ulps(found, decimal_atan2(y, x)) <= 2


@pytest.mark.parametrize("eighths", range(-3, 5))
def test_directions_of_axes_and_diagonals_are_exact(eighths: int) -> None:
    x, y = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)][eighths]
    assert portable.atan2(float(y), float(x)) == eighths * math.pi / 4


def test_the_sign_of_zero_does_not_turn_a_direction() -> None:
    assert portable.atan2(-0.0, -1.0) == portable.atan2(0.0, -1.0) == math.pi
    assert np.array_equal(portable.atan2(np.array((-0.0, 0.0)), np.array((-1.0, -1.0))), (math.pi, math.pi))
    many = np.zeros(20)
    assert np.array_equal(portable.atan2(-many, many - 1.0), many + math.pi)


@pytest.mark.slow
@given(x=EXPONENTS, small=st.floats(-0.9, 0.9).filter(lambda x: abs(x) > 1e-30), positive=POSITIVE)
def test_exponential_and_logarithm_are_accurate(x: float, small: float, positive: float) -> None:
    with localcontext(prec=DIGITS):
        assert ulps(portable.exp(x), Decimal(x).exp()) <= 2
        assert ulps(portable.expm1(small), Decimal(small).exp() - 1) <= 4
        if positive != 1.0:
            assert ulps(portable.log(positive), Decimal(positive).ln()) <= 2


@given(x=LENGTHS, y=LENGTHS)
def test_lengths_agree_with_the_library(x: float, y: float) -> None:
    assert portable.hypot(x, y) == pytest.approx(math.hypot(x, y), rel=3e-16)
    assert portable.distance((x, y), (y, 1.0)) == pytest.approx(math.dist((x, y), (y, 1.0)), rel=3e-16)


ONE_ARGUMENT: dict[str, tuple[Callable[[Float], Float], Callable[[float], float], tuple[float, float]]] = {
    "cos": (portable.cos, portable.cos, (-30, 30)),
    "sin": (portable.sin, portable.sin, (-30, 30)),
    "tan": (portable.tan, portable.tan, (-1.5, 1.5)),
    "sinc": (portable.sinc, portable.sinc, (-3, 3)),
    "exp": (portable.exp, portable.exp, (-600, 600)),
    "log": (portable.log, portable.log, (1e-9, 4)),
}
"""Function of arrays, of numbers, and the range of arguments."""


@pytest.mark.parametrize("name", ONE_ARGUMENT)
@pytest.mark.parametrize("size", [0, 1, 10, 500])
def test_numbers_and_arrays_have_the_same_bits(name: str, size: int) -> None:
    of_arrays, of_numbers, (low, high) = ONE_ARGUMENT[name]
    values = np.random.default_rng(size).uniform(low, high, size)
    expected = np.array([of_numbers(value) for value in values.tolist()], dtype=np.float64)
    assert of_arrays(values).tobytes() == expected.tobytes()
    assert of_arrays(values.reshape(-1, 1)).shape == (size, 1)


@pytest.mark.parametrize("size", [0, 1, 10, 500])
def test_numbers_and_arrays_have_the_same_directions_and_lengths(size: int) -> None:
    y, x = np.random.default_rng(size).normal(size=(2, size))
    rows = list(zip(y.tolist(), x.tolist(), strict=True))
    assert portable.atan2(y, x).tolist() == [portable.atan2(*row) for row in rows]
    assert portable.hypot(y, x).tolist() == [portable.hypot(*row) for row in rows]


@given(slope=st.floats(-1e6, 1e6))
def test_an_arc_tangent_is_a_direction(slope: float) -> None:
    assert portable.atan(slope) == portable.atan2(slope, 1.0)


def test_arrays_of_32_bits_are_computed_in_64() -> None:
    angles = np.linspace(-4.0, 4.0, 50).astype(np.float32)
    assert portable.cos(angles).tobytes() == portable.cos(angles.astype(np.float64)).tobytes()
    assert portable.exp(angles).tobytes() == portable.exp(angles.astype(np.float64)).tobytes()


def test_arguments_broadcast() -> None:
    y, x = np.arange(1.0, 6.0)[:, None], np.arange(-3.0, 3.0)
    assert np.allclose(portable.atan2(y, x), np.arctan2(y, x), rtol=1e-15)
    assert np.allclose(portable.atan2(y[:2, 0], 1.0), np.arctan2(y[:2, 0], 1.0), rtol=1e-15)


def test_tables_are_the_nearest_floats() -> None:
    tables = portable_tables.load_tables()
    cosines, sines, tangents = tables.cosines.tolist(), tables.sines.tolist(), tables.arc_tangents.tolist()
    assert (len(cosines), len(tangents)) == (portable_tables.TURN_STEPS, portable_tables.ATAN_STEPS + 1)
    with localcontext(prec=DIGITS + 20):
        for i in range(0, len(cosines), 97):
            assert cosines[i] == float(decimal_cos(2 * PI * i / len(cosines)))
            assert abs(sines[i] - float(decimal_sin(2 * PI * i / len(cosines)))) < 1e-16
        assert [tangents[i] for i in (0, 1, 77, 256)] == [float(decimal_atan2(i, 256)) for i in (0, 1, 77, 256)]


def test_the_file_of_the_tables_holds_what_is_computed() -> None:
    computed = np.array(portable_tables.compute_file_values(), "<f8")
    assert portable_tables.FILE.read_bytes() == computed.tobytes()


def test_the_bits_are_known() -> None:
    """The same on every machine: this digest was computed on one with AVX-512, glibc 2.36 and NumPy 2.4."""
    values = np.random.RandomState(7).uniform(-10.0, 10.0, (2, 4000))
    found = (
        *portable.cos_sin(values[0]),
        portable.atan2(values[0], values[1]),
        portable.exp(values[0]),
        portable.log(np.abs(values[0])),
        portable.hypot(values[0], values[1]),
        np.array([portable.expm1(value) for value in values[1].tolist()]),
    )
    digest = blake2b(b"".join(one.tobytes() for one in found), digest_size=8).hexdigest()
    assert digest == "b1f49f4576fe72c3"
