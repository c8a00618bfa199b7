"""find_held_out: hold out a part of a data set."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError

HELD_OUT = 20
"""One of so many scenarios is held out where no validation data is given."""


def find_held_out(arrays: Mapping[str, npt.NDArray[np.generic]]) -> npt.NDArray[np.int64]:
    """Return the rows that are held out: all cars of the last of every HELD_OUT scenarios, by their index.

    Rounds of DAgger drive the scenarios of the first data set again; the same indices are held out there. Of fewer than
    HELD_OUT scenarios the last one is held out, which a longer round would train on. Raises InputError if there is only
    one.
    """
    scenarios = arrays["scenario"].astype(np.int64)
    held_out = np.flatnonzero(scenarios % HELD_OUT == HELD_OUT - 1)
    if not len(held_out) and len(scenarios):
        held_out = np.flatnonzero(scenarios == scenarios.max())
    if len(held_out) == len(scenarios):
        raise InputError("data set: expected two scenarios or more to hold one out, found fewer; give --val")
    return held_out
