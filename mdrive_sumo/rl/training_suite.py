"""write_training_suite: training scenarios at drawn places as a suite, so that no policy trains on one that scores."""

from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.sample_format import PLACES_FOLDER
from mdrive_sumo.learning.training_scenarios import build_training_scenario
from mdrive_sumo.worlds.authoring.suite_folder import save_in_suite


def write_training_suite(
    folder: Path, scenarios: int, *, split: str = "train", seed: int = 0, places: Path | None = None
) -> tuple[str, ...]:
    """Write the first training scenarios of a seed into the folder of a suite, and return their ids.

    They are those that `mdrive-sumo learn data` drives, ten at each place. split: `train`, `val` or `test`, which have
    no place in common. places: folder with drawn places, `places` beside the suite by default; what it lacks is drawn,
    which needs netconvert. Raises InputError.
    """
    if scenarios < 1:
        raise InputError(f"training suite: scenarios: expected at least 1, found {scenarios}")
    ids: list[str] = []
    for index in range(scenarios):
        built = build_training_scenario(split, seed, index, places or folder.parent / PLACES_FOLDER)
        if built is not None:
            save_in_suite(*built, folder)
            ids.append(built[0].id)
    return tuple(ids)
