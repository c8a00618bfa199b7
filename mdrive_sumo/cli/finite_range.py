"""FiniteRange: a number of the command line between two bounds; `click.FloatRange` also accepts "nan"."""

import math
from typing import Any

import click


class FiniteRange(click.FloatRange):
    """`click.FloatRange` without NaN, which is neither below nor above a bound."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number. Raises click.BadParameter."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"expected a number, found {value!r}", param, ctx)
        return number
