"""Check the numbers of a SUMO network from strangers before anything is computed from them."""

from collections.abc import Sequence
from itertools import chain
from typing import Any

MAX_COORDINATE_M = 1e8
"""[m] Any projection of the earth has smaller ones."""


def check_net_numbers(net: Any, lanes: Sequence[Any]) -> None:
    """Raise ValueError for coordinates, widths or speeds that no road has: products of larger ones overflow."""
    shapes = [lane.getShape() for lane in lanes] + [node.getShape() for node in net.getNodes()]
    for value in chain((number for shape in shapes for point in shape for number in point), *map(_list_numbers, lanes)):
        if not abs(value) <= MAX_COORDINATE_M:
            raise ValueError(f"numbers within {MAX_COORDINATE_M:g} expected, found {value:g}")


def _list_numbers(lane: Any) -> tuple[float, ...]:
    return lane.getWidth(), lane.getSpeed(), lane.getLength()
