"""Arrays of many samples: joining data sets, and holding a part of one out."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError

Arrays = dict[str, npt.NDArray[np.generic]]
HELD_OUT = 20
"""One of so many cars' drives is held out where no validation data is given."""


def join_arrays(parts: Sequence[Arrays]) -> Arrays:
    """Return the samples of several data sets in a row; rows of previous samples and numbers of episodes are shifted."""
    rows = episodes = 0
    shifted: list[Arrays] = []
    for part in parts:
        previous = part["previous"].astype(np.int64)
        shifted.append(
            {**part, "previous": np.where(previous < 0, -1, previous + rows), "episode": part["episode"] + episodes}
        )
        rows += len(previous)
        episodes += int(part["episode"].max(initial=-1)) + 1
    if len(shifted) == 1:
        return shifted[0]
    return {name: np.concatenate([part[name] for part in shifted]) for name in shifted[0]}


def split_arrays(arrays: Mapping[str, npt.NDArray[np.generic]]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the rows to train on and those held out: all samples of one car's drive lie on one side.

    Raises InputError if either side is empty.
    """
    is_held_out = arrays["episode"].astype(np.int64) % HELD_OUT == HELD_OUT - 1
    training, held_out = np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)
    if not len(training) or not len(held_out):
        raise InputError(f"data set: expected at least {HELD_OUT} drives of a car to hold one out, found fewer; give --val")
    return training, held_out
