"""Rice codes of arrays of non-negative integers: small numbers take few bits, and every host makes the same bits.

A number n with parameter k is n >> k in unary (zeros, then a one) and the low k bits of n; Rice and Plaunt, IEEE Trans.
Communication Technology 19(6), 1971. All low bits come first, then all unary parts, so that NumPy reads them at once.
"""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Int

MAX_PARAMETER = 15
"""Numbers below 2^16 never gain from a larger parameter."""
Bits = npt.NDArray[np.uint8]
"""Values 0 and 1."""


def count_rice_bits(numbers: Int, parameter: int) -> Int:
    """Return how many bits each number takes."""
    return (numbers >> parameter) + (1 + parameter)


def choose_parameter(numbers: Int) -> int:
    """Return the parameter with which the numbers take the fewest bits; the smallest of equals."""
    sums = [int((numbers >> k).sum()) + k * len(numbers) for k in range(MAX_PARAMETER + 1)]
    return sums.index(min(sums))


def encode_rice(numbers: Int, parameter: int) -> tuple[Bits, Bits]:
    """Return the low bits, and the unary parts, of numbers (N,)."""
    ends = np.cumsum((numbers >> parameter) + 1)
    unary = np.zeros(ends[-1] if len(ends) else 0, dtype=np.uint8)
    unary[ends - 1] = 1
    low = numbers[:, None] >> np.arange(parameter - 1, -1, -1) & 1
    return low.astype(np.uint8).ravel(), unary


def decode_rice(low: Bits, quotients: Int, parameter: int) -> Int:
    """Return the numbers (N,): low: N times `parameter` bits; quotients: what stood in unary (N,)."""
    shifted = low.reshape(len(quotients), parameter).astype(np.int64) << np.arange(parameter - 1, -1, -1)
    return (quotients << parameter) + shifted.sum(axis=1)


def read_unary(bits: Bits) -> Int:
    """Return the numbers that stand in unary: of zeros before each one."""
    return np.diff(np.flatnonzero(bits), prepend=-1) - 1
