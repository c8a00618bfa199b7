"""Data that is not trained on: places held out of a data set, and data sets of other places."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.sample_format import SCENARIOS_PER_PLACE
from mdrive_sumo.learning.shard_reading import load_dataset_file

HELD_OUT = 20
"""One of so many places is held out where no validation data is given."""


def find_held_out(arrays: Mapping[str, npt.NDArray[np.generic]]) -> npt.NDArray[np.int64]:
    """Return the rows that are held out: all cars at the last of every HELD_OUT places, by the scenario's index.

    Rounds of DAgger drive the scenarios of the first data set again; the same places are held out there. Of fewer than
    HELD_OUT places the last one is held out, which a longer round would train on; of scenarios of one place the last
    one. Raises InputError if there is only one.
    """
    scenarios = arrays["scenario"].astype(np.int64)
    places = scenarios // SCENARIOS_PER_PLACE
    held_out = np.flatnonzero(places % HELD_OUT == HELD_OUT - 1)
    for numbers in (places, scenarios):
        if len(numbers) and len(held_out) in (0, len(scenarios)):
            held_out = np.flatnonzero(numbers == numbers.max())
    if len(held_out) == len(scenarios):
        raise InputError("data set: expected two scenarios or more to hold one out, found fewer; give --val")
    return held_out


def check_apart(data: Sequence[Path], validation: Sequence[Path]) -> None:
    """Check that none is validated on the places that another one is trained on. Raises InputError.

    Data sets of one split and seed have the same places. Without validation data none is read.
    """
    if not validation:
        return
    trained = {_name_places(folder): folder for folder in data}
    for folder in validation:
        split, seed, _ = places = _name_places(folder)
        if places in trained:
            raise InputError(
                f"--val {folder}: expected places that are not trained on, found those of --data {trained[places]}:"
                f" both are of split {split}, seed {seed}; `learn data --split val` makes others"
            )


def _name_places(folder: Path) -> tuple[str, int, str]:
    about = load_dataset_file(folder)
    return about.split, about.seed, about.suite
