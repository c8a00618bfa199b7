"""Elementary functions that give the same bits on every machine, for numbers and for arrays.

`math` and NumPy leave sine, cosine, arc tangent, exponential, logarithm, powers and `hypot` to the C library and to
vector code, which choose an implementation by processor and version: the last digit differs. The functions here use
only operations whose result IEEE 754 prescribes (+, -, *, /, square root, rounding, comparison) and tables made with
integers. A number and an element of an array go through the same formula, so their results are equal too.
portable.c computes the same (`core.compiled`); portable.h has it for other C files.

Accuracy: cosine and sine within 2e-16 (1 + |angle|), and exact at multiples of a right angle; arc tangent, exponential
and logarithm within 2 units in the last place, `expm1` and sines of small angles within 4. Arguments are finite, and
-0.0 counts as 0.0.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable_tables as tables
from mdrive_sumo.core.compiled import twin

Float = npt.NDArray[np.float64]
Reals = npt.NDArray[np.floating[Any]]
"""Arrays that the functions take; they compute in 64 bits."""
Operand = TypeVar("Operand", float, Float)

_STEPS, _RADIANS, *_TABLES = tables.load_tables()
_COS, _SIN, _ATAN = (table.tolist() for table in _TABLES)
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
def cos_sin(angle: float, /) -> tuple[float, float]: ...
@overload
def cos_sin(angle: Reals, /) -> tuple[Float, Float]: ...
@twin
def cos_sin(angle: float | Reals, /) -> tuple[float | Float, float | Float]:
    """Return cosine and sine of the angle [rad]; together they cost little more than one."""
    if isinstance(angle, _ARRAY):
        pairs = np.array([cos_sin(value) for value in angle.ravel().tolist()], dtype=np.float64).reshape(-1, 2)
        return pairs[:, 0].reshape(angle.shape), pairs[:, 1].reshape(angle.shape)
    steps = float(angle) * _STEPS
    whole = round(steps)
    steps -= whole
    row = whole & _MASK
    cos, sin = _COS[row], _SIN[row]
    square = steps * steps
    along, aside = 1.0 - square * _COS_2, steps * (_SIN_1 - square * _SIN_3)
    return cos * along - sin * aside, sin * along + cos * aside


@overload
def cos(angle: float, /) -> float: ...
@overload
def cos(angle: Reals, /) -> Float: ...
@twin
def cos(angle: float | Reals, /) -> float | Float:
    """Return the cosine of the angle [rad]."""
    return cos_sin(angle)[0]


@overload
def sin(angle: float, /) -> float: ...
@overload
def sin(angle: Reals, /) -> Float: ...
@twin
def sin(angle: float | Reals, /) -> float | Float:
    """Return the sine of the angle [rad]."""
    return cos_sin(angle)[1]


@overload
def tan(angle: float, /) -> float: ...
@overload
def tan(angle: Reals, /) -> Float: ...
@twin
def tan(angle: float | Reals, /) -> float | Float:
    """Return the tangent of the angle [rad]; a quarter turn divides by zero."""
    if isinstance(angle, _ARRAY):
        return _each(tan, angle)
    x, y = cos_sin(angle)
    return y / x


@overload
def sinc(x: float, /) -> float: ...
@overload
def sinc(x: Reals, /) -> Float: ...
@twin
def sinc(x: float | Reals, /) -> float | Float:
    """Return sin(pi x) / (pi x), 1 where x is 0: as `numpy.sinc`."""
    if isinstance(x, _ARRAY):
        return _each(sinc, x)
    return cos_sin(_PI * x)[1] / (_PI * x) if x else 1.0


@overload
def atan2(y: float, x: float, /) -> float: ...
@overload
def atan2(y: Reals, x: Reals | float, /) -> Float: ...
@overload
def atan2(y: float, x: Reals, /) -> Float: ...
@twin
def atan2(y: float | Reals, x: float | Reals, /) -> float | Float:
    """Return the direction [rad] of (x, y) in (-pi, pi]; 0 for (0, 0). As `math.atan2`, but -0.0 is 0.0."""
    if isinstance(y, _ARRAY) or isinstance(x, _ARRAY):
        return _each(atan2, y, x)
    high, low = abs(float(y)), abs(float(x))
    is_steep = high > low
    if not is_steep:
        high, low = low, high
    angle = _atan_of_slope(low / max(high, _TINY))
    if is_steep:
        angle = _HALF_PI - angle
    if x < 0.0:
        angle = _PI - angle
    return -angle if y < 0.0 else angle


@twin
def atan(slope: float, /) -> float:
    """Return the arc tangent [rad]: atan2(slope, 1), without its cases."""
    steep = abs(slope)
    angle = _atan_of_slope(1.0 / steep if steep > 1.0 else steep)
    if steep > 1.0:
        angle = _HALF_PI - angle
    return -angle if slope < 0.0 else angle


def _atan_of_slope(slope: float) -> float:
    """Return the angle [rad] whose tangent is a slope in [0, 1]."""
    row = round(slope * tables.ATAN_STEPS)
    near = row * _SLOPE_STEP
    rest = (slope - near) / (1.0 + slope * near)
    square = rest * rest
    return _ATAN[row] + (rest + rest * square * (square * 0.2 - _THIRD))


@overload
def hypot(x: float, y: float, /) -> float: ...
@overload
def hypot(x: Reals, y: Reals | float, /) -> Float: ...
@twin
def hypot(x: float | Reals, y: float | Reals, /) -> float | Float:
    """Return the length of (x, y), both well within 1e-150 and 1e150 or zero."""
    if isinstance(x, _ARRAY) or isinstance(y, _ARRAY):
        return _each(hypot, x, y)
    x, y = float(x), float(y)
    return math.sqrt(x * x + y * y)


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
def exp(x: float, /) -> float: ...
@overload
def exp(x: Reals, /) -> Float: ...
@twin
def exp(x: float | Reals, /) -> float | Float:
    """Return e to the power of x. Raises OverflowError above 709."""
    if isinstance(x, _ARRAY):
        return _each(exp, x)
    x = min(max(float(x), -1e4), 1e4)  # the result is 0 or too large anyway
    power = round(x * _PER_LN2)
    rest = x - power * _LN2_HIGH - power * _LN2_LOW
    return math.ldexp(1.0 + (rest + rest * rest * _evaluate(_FACTORIALS, rest)), power)


@twin
def expm1(x: float, /) -> float:
    """Return e to the power of x, less 1, accurately where x is small."""
    return x + x * x * _evaluate(_FACTORIALS, x) if abs(x) < 0.34 else exp(x) - 1.0


@overload
def log(x: float, /) -> float: ...
@overload
def log(x: Reals, /) -> Float: ...
@twin
def log(x: float | Reals, /) -> float | Float:
    """Return the natural logarithm of x > 0. Raises ValueError for other numbers."""
    if isinstance(x, _ARRAY):
        return _each(log, x)
    if not 0.0 < x < math.inf:
        raise ValueError(f"expected a positive number, found {x}")
    mantissa, power = math.frexp(x)
    if mantissa < _ROOT_HALF:
        mantissa, power = 2.0 * mantissa, power - 1
    share = (mantissa - 1.0) / (mantissa + 1.0)
    square = share * share
    tail = 2.0 * (share * square) * _evaluate(_ODD, square)
    return power * _LN2_HIGH + (2.0 * share + (tail + power * _LN2_LOW))


def _evaluate(coefficients: Sequence[float], x: float) -> float:
    """Return the polynomial with these coefficients, highest degree first (Horner's scheme)."""
    value = coefficients[0] * x + coefficients[1]
    for coefficient in coefficients[2:]:
        value = value * x + coefficient
    return value


def _each(function: Callable[..., float], *arguments: float | Reals) -> Float:
    """Return the function of every element of arrays and numbers that broadcast."""
    columns = np.broadcast_arrays(*(np.asarray(argument, dtype=np.float64) for argument in arguments))
    rows = zip(*(column.ravel().tolist() for column in columns), strict=True)
    return np.array([function(*row) for row in rows], dtype=np.float64).reshape(columns[0].shape)
