"""Elementary functions that give the same bits on every machine, for numbers and for arrays.

`math` and NumPy leave sine, cosine, arc tangent, exponential, logarithm, powers and `hypot` to the C library and to
vector code, which choose an implementation by processor and version: the last digit differs. The functions here use
only operations whose result IEEE 754 prescribes (+, -, *, /, square root, rounding, comparison) and tables made with
integers. A number and an element of an array go through the same formula, so their results are equal too.

Accuracy: cosine and sine within 2e-16 (1 + |angle|), and exact at multiples of a right angle; arc tangent, exponential
and logarithm within 2 units in the last place, `expm1` and sines of small angles within 4. Arguments are finite, and
-0.0 counts as 0.0. An array of few elements is computed one by one, which is faster.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable_tables as tables

Float = npt.NDArray[np.float64]
Reals = npt.NDArray[np.floating[Any]]
"""Arrays that the functions take; they compute in 64 bits."""
Operand = TypeVar("Operand", float, Float)

FEW = 10
"""Elements up to which numbers one by one are faster than array operations (measured with NumPy 2.4: 8 to 15)."""

_STEPS, _RADIANS, _COS_TABLE, _SIN_TABLE, _ATAN_TABLE = tables.load_tables()
_COS, _SIN, _ATAN = _COS_TABLE.tolist(), _SIN_TABLE.tolist(), _ATAN_TABLE.tolist()
_MASK = tables.TURN_STEPS - 1
_SIN_1, _SIN_3 = _RADIANS, _RADIANS * _RADIANS * _RADIANS / 6
"""sin(r) = r (_SIN_1 - r² _SIN_3) for an angle of r steps, |r| <= 1/2: the next term is below 1e-16 of it."""
_COS_2 = _RADIANS * _RADIANS * (0.5 - 0.828 * (_RADIANS / 2) * (_RADIANS / 2) / 24)
"""cos(r) = 1 - r² _COS_2: r⁴ / 24 is replaced by the multiple of r² nearest to it, which errs by 1e-17."""
_SLOPE_STEP, _THIRD = 1 / tables.ATAN_STEPS, 1 / 3
_ARRAY = np.ndarray
_PI, _HALF_PI = math.pi, math.pi / 2
_TINY = 1e-300
"""Added as a least divisor: atan2(0, 0) divides by it instead of by 0."""
_LN2_HIGH, _LN2_LOW, _PER_LN2 = 6.93147180369123816490e-01, 1.90821492927058770002e-10, 1.44269504088896338700
"""ln 2 as a sum whose first part has 32 bits (times an exponent it is exact), and 1 / ln 2 (fdlibm, e_exp.c)."""
_ROOT_HALF = 0.7071067811865476
_FACTORIALS = tuple(1 / math.factorial(n) for n in range(13, 1, -1))
"""Coefficients of (exp(r) - 1 - r) / r², highest degree first, for |r| <= ln 2 / 2."""
_ODD = tuple(1 / n for n in range(21, 2, -2))
"""Coefficients of (artanh(s) - s) / s³ in s², highest degree first, for |s| <= 0.172."""


@overload
def cos_sin(angle: float) -> tuple[float, float]: ...
@overload
def cos_sin(angle: Reals) -> tuple[Float, Float]: ...
def cos_sin(angle: float | Reals) -> tuple[float | Float, float | Float]:
    """Return cosine and sine of the angle [rad]; together they cost little more than one."""
    if not isinstance(angle, _ARRAY):
        steps = float(angle) * _STEPS
        whole = round(steps)
        steps -= whole
        row = whole & _MASK
        cos, sin = _COS[row], _SIN[row]
        square = steps * steps
        along, aside = 1.0 - square * _COS_2, steps * (_SIN_1 - square * _SIN_3)
        return cos * along - sin * aside, sin * along + cos * aside
    if angle.size <= FEW:
        pairs = [cos_sin(value) for value in angle.ravel().tolist()]
        first, second = zip(*pairs, strict=True) if pairs else ((), ())
        return np.array(first).reshape(angle.shape), np.array(second).reshape(angle.shape)
    return _cos_sin_of_many(angle)


def _cos_sin_of_many(angle: Reals) -> tuple[Float, Float]:
    steps = np.multiply(angle, _STEPS, dtype=np.float64)
    whole = np.rint(steps)
    steps -= whole
    row = whole.astype(np.int64) & _MASK
    cos, sin = _COS_TABLE.take(row), _SIN_TABLE.take(row)
    square = steps * steps
    along, aside = 1.0 - square * _COS_2, steps * (_SIN_1 - square * _SIN_3)
    return cos * along - sin * aside, sin * along + cos * aside


@overload
def cos(angle: float) -> float: ...
@overload
def cos(angle: Reals) -> Float: ...
def cos(angle: float | Reals) -> float | Float:
    """Return the cosine of the angle [rad]."""
    return cos_sin(angle)[0]


@overload
def sin(angle: float) -> float: ...
@overload
def sin(angle: Reals) -> Float: ...
def sin(angle: float | Reals) -> float | Float:
    """Return the sine of the angle [rad]."""
    return cos_sin(angle)[1] if isinstance(angle, _ARRAY) else _sin_number(float(angle))


def _sin_number(angle: float) -> float:
    """Return the second value of `cos_sin`, without the first: paths integrate it point by point."""
    steps = angle * _STEPS
    whole = round(steps)
    steps -= whole
    row = whole & _MASK
    square = steps * steps
    return _SIN[row] * (1.0 - square * _COS_2) + _COS[row] * (steps * (_SIN_1 - square * _SIN_3))


@overload
def tan(angle: float) -> float: ...
@overload
def tan(angle: Reals) -> Float: ...
def tan(angle: float | Reals) -> float | Float:
    """Return the tangent of the angle [rad]; a quarter turn divides by zero."""
    x, y = cos_sin(angle)
    return y / x


@overload
def sinc(x: float) -> float: ...
@overload
def sinc(x: Reals) -> Float: ...
def sinc(x: float | Reals) -> float | Float:
    """Return sin(pi x) / (pi x), 1 where x is 0: as `numpy.sinc`."""
    if not isinstance(x, _ARRAY):
        return sin(_PI * x) / (_PI * x) if x else 1.0
    angle = np.where(x == 0.0, 1.0, _PI * x)
    return np.where(x == 0.0, 1.0, sin(angle) / angle)


@overload
def atan2(y: float, x: float) -> float: ...
@overload
def atan2(y: Reals, x: Reals | float) -> Float: ...
@overload
def atan2(y: float, x: Reals) -> Float: ...
def atan2(y: float | Reals, x: float | Reals) -> float | Float:
    """Return the direction [rad] of (x, y) in (-pi, pi]; 0 for (0, 0). As `math.atan2`, but -0.0 is 0.0."""
    if not (isinstance(y, _ARRAY) or isinstance(x, _ARRAY)):
        return _atan2_number(float(y), float(x))
    y, x = np.asarray(y, dtype=np.float64), np.asarray(x, dtype=np.float64)
    if x.size <= FEW and y.size <= FEW:
        return _each(_atan2_number, y, x)
    high, low = np.abs(y), np.abs(x)
    is_steep = high > low
    high, low = np.maximum(high, low), np.minimum(high, low)
    slope = low / np.maximum(high, _TINY)
    row = np.rint(slope * tables.ATAN_STEPS)
    near = row * _SLOPE_STEP
    rest = (slope - near) / (1.0 + slope * near)
    square = rest * rest
    angle = _ATAN_TABLE.take(row.astype(np.int64)) + (rest + rest * square * (square * 0.2 - _THIRD))
    angle = np.where(is_steep, _HALF_PI - angle, angle)
    return np.copysign(np.where(x < 0.0, _PI - angle, angle), y + 0.0)


def _atan2_number(y: float, x: float) -> float:
    high, low = abs(y), abs(x)
    is_steep = high > low
    if not is_steep:
        high, low = low, high
    slope = low / max(high, _TINY)
    row = round(slope * tables.ATAN_STEPS)
    near = row * _SLOPE_STEP
    rest = (slope - near) / (1.0 + slope * near)
    square = rest * rest
    angle = _ATAN[row] + (rest + rest * square * (square * 0.2 - _THIRD))
    if is_steep:
        angle = _HALF_PI - angle
    if x < 0.0:
        angle = _PI - angle
    return -angle if y < 0.0 else angle


def atan(slope: float) -> float:
    """Return the arc tangent [rad]: atan2(slope, 1), without its cases."""
    steep = abs(slope)
    low = 1.0 / steep if steep > 1.0 else steep
    row = round(low * tables.ATAN_STEPS)
    near = row * _SLOPE_STEP
    rest = (low - near) / (1.0 + low * near)
    square = rest * rest
    angle = _ATAN[row] + (rest + rest * square * (square * 0.2 - _THIRD))
    if steep > 1.0:
        angle = _HALF_PI - angle
    return -angle if slope < 0.0 else angle


@overload
def hypot(x: float, y: float) -> float: ...
@overload
def hypot(x: Reals, y: Reals | float) -> Float: ...
def hypot(x: float | Reals, y: float | Reals) -> float | Float:
    """Return the length of (x, y), both well within 1e-150 and 1e150 or zero."""
    square = x * x + y * y
    return np.sqrt(square) if isinstance(square, _ARRAY) else math.sqrt(square)


def square(x: Operand) -> Operand:
    """Return x times x: `**` calls the C library for a number."""
    return x * x


def dot(first: Float, second: Float) -> Float:
    """Return the sums of products (...,) over the last axis, from first to last; the others broadcast.

    Matrix products go to a linear-algebra library that sums in an order, and with instructions, of its own.
    """
    total = first[..., 0] * second[..., 0]
    for i in range(1, first.shape[-1]):
        total = total + first[..., i] * second[..., i]
    return total


def distance(first: Sequence[float] | Reals, second: Sequence[float] | Reals) -> float:
    """Return the distance of two points with as many coordinates: as `math.dist`."""
    return math.sqrt(math.fsum([square(a - b) for a, b in zip(first, second, strict=True)]))


@overload
def exp(x: float) -> float: ...
@overload
def exp(x: Reals) -> Float: ...
def exp(x: float | Reals) -> float | Float:
    """Return e to the power of x, |x| <= 700."""
    if not isinstance(x, _ARRAY):
        return _exp_number(float(x))
    x = np.asarray(x, dtype=np.float64)
    if x.size <= FEW:
        return _each(_exp_number, x)
    power = np.rint(x * _PER_LN2)
    rest = x - power * _LN2_HIGH - power * _LN2_LOW
    return np.ldexp(1.0 + (rest + rest * rest * _evaluate(_FACTORIALS, rest)), power.astype(np.int32))


def _exp_number(x: float) -> float:
    power = round(x * _PER_LN2)
    rest = x - power * _LN2_HIGH - power * _LN2_LOW
    return math.ldexp(1.0 + (rest + rest * rest * _evaluate(_FACTORIALS, rest)), power)


def expm1(x: float) -> float:
    """Return e to the power of x, less 1, accurately where x is small."""
    return x + x * x * _evaluate(_FACTORIALS, x) if abs(x) < 0.34 else exp(x) - 1.0


@overload
def log(x: float) -> float: ...
@overload
def log(x: Reals) -> Float: ...
def log(x: float | Reals) -> float | Float:
    """Return the natural logarithm of x > 0."""
    if not isinstance(x, _ARRAY):
        return _log_number(float(x))
    x = np.asarray(x, dtype=np.float64)
    if x.size <= FEW:
        return _each(_log_number, x)
    mantissa, power = np.frexp(x)
    is_low = mantissa < _ROOT_HALF
    mantissa, power = np.where(is_low, 2.0 * mantissa, mantissa), (power - is_low).astype(np.float64)
    share = (mantissa - 1.0) / (mantissa + 1.0)
    square = share * share
    tail = 2.0 * (share * square) * _evaluate(_ODD, square)
    return power * _LN2_HIGH + (2.0 * share + (tail + power * _LN2_LOW))


def _log_number(x: float) -> float:
    mantissa, power = math.frexp(x)
    if mantissa < _ROOT_HALF:
        mantissa, power = 2.0 * mantissa, power - 1
    share = (mantissa - 1.0) / (mantissa + 1.0)
    square = share * share
    tail = 2.0 * (share * square) * _evaluate(_ODD, square)
    return power * _LN2_HIGH + (2.0 * share + (tail + power * _LN2_LOW))


def _evaluate(coefficients: Sequence[float], x: Operand) -> Operand:
    """Return the polynomial with these coefficients, highest degree first (Horner's scheme)."""
    value = coefficients[0] * x + coefficients[1]
    for coefficient in coefficients[2:]:
        value = value * x + coefficient
    return value


def _each(function: Callable[..., float], *arguments: Float) -> Float:
    """Return the function of every element of arrays that broadcast."""
    shape = arguments[0].shape
    if any(one.shape != shape for one in arguments):
        arguments = np.broadcast_arrays(*arguments)
        shape = arguments[0].shape
    rows = zip(*(one.ravel().tolist() for one in arguments), strict=True)
    return np.array([function(*row) for row in rows], dtype=np.float64).reshape(shape)
