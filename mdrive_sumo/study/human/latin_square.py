"""Orders in which every item comes equally often in every place, and equally often right after every other item."""

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def build_latin_square(size: int) -> tuple[tuple[int, ...], ...]:
    """Return the rows of a balanced Latin square over the numbers 0 to size - 1; `size` rows if that is even or 1.

    For an even size it is the design of Williams (Experimental designs balanced for the estimation of residual effects
    of treatments, Australian Journal of Scientific Research A 2, 1949): every number is once in every column, and once
    right after every other number. An odd size needs the square and its mirror image, 2 · size rows, for the same:
    twice in every column, and twice right after every other number. Raises ValueError for a size below 1.
    """
    if size < 1:
        raise ValueError(f"Latin square: expected a size of at least 1, found {size}")
    first = [0] * size
    low, high = 1, size - 1
    for place in range(1, size):  # 0, 1, n - 1, 2, n - 2, ...
        if place % 2:
            first[place], low = low, low + 1
        else:
            first[place], high = high, high - 1
    rows = [tuple((number + shift) % size for number in first) for shift in range(size)]
    if size % 2 and size > 1:
        rows += [row[::-1] for row in rows]
    return tuple(rows)


def order_items(items: Sequence[T], row: int) -> tuple[T, ...]:
    """Return the items in the order of a row of their balanced Latin square; rows repeat after the last one."""
    square = build_latin_square(len(items))
    return tuple(items[place] for place in square[row % len(square)])
