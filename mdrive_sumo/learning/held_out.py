"""split_arrays: hold out a part of a data set."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError

HELD_OUT = 20
"""One of so many cars' drives is held out where no validation data is given."""


def split_arrays(arrays: Mapping[str, npt.NDArray[np.generic]]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the rows to train on and those held out: all samples of one car's drive lie on one side.

    Raises InputError if either side is empty.
    """
    is_held_out = arrays["episode"].astype(np.int64) % HELD_OUT == HELD_OUT - 1
    training, held_out = np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)
    if not len(training) or not len(held_out):
        raise InputError(
            f"data set: expected at least {HELD_OUT} drives of a car to hold one out, found fewer; give --val"
        )
    return training, held_out
