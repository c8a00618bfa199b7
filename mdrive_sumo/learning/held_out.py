"""find_held_out: hold out a part of a data set."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError

HELD_OUT = 20
"""One of so many cars' drives is held out where no validation data is given."""


def find_held_out(arrays: Mapping[str, npt.NDArray[np.generic]]) -> npt.NDArray[np.int64]:
    """Return the rows that are held out, whole drives of a car. Raises InputError if there are none."""
    held_out = np.flatnonzero(arrays["episode"].astype(np.int64) % HELD_OUT == HELD_OUT - 1)
    if not len(held_out):
        raise InputError(
            f"data set: expected {HELD_OUT} drives of a car or more to hold one out, found fewer; give --val"
        )
    return held_out
