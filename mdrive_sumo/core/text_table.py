"""Aligned plain text. Needs nothing, so that `doctor` can use it on a broken installation."""

import re
from collections.abc import Iterable, Sequence

Row = Sequence[str]

NUMBER = re.compile(r"[-+]?[\d.]*")


def text_table(header: Row, rows: Iterable[Row]) -> str:
    """An aligned table: columns of numbers flush right, all others flush left."""
    body = [tuple(row) for row in rows]
    columns = [_aligned(column) for column in zip(tuple(header), *body, strict=True)]
    lines = ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]
    return "\n".join((lines[0], "-" * max(map(len, lines)), *lines[1:]))


def _aligned(column: Row) -> list[str]:
    width = max(map(len, column))
    if all(map(NUMBER.fullmatch, column[1:])):
        return [cell.rjust(width) for cell in column]
    return [cell.ljust(width) for cell in column]
