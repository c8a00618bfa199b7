"""collect_round: data of one round of DAgger, made as the data set that the first round was trained on."""

from pathlib import Path

from mdrive_sumo.learning.collection import CollectionProgress, collect_dataset
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.shard_reading import load_dataset_file

EXPERT_SHARE = 0.2
"""Of the segments of a drive, as `learn data --mix`."""


def collect_round(first: Path, round_: int, weights: Path, folder: Path, scenarios: int, workers: int, progress: CollectionProgress) -> None:
    """Let weights drive so many scenarios and write the samples into a folder. Raises InputError.

    first: data set whose split, seed, expert, rigs and perturbation are used again.
    """
    made = load_dataset_file(first)
    settings = CollectionSettings(
        split=made.split,
        seed=made.seed,
        expert=made.expert,
        rigs=made.rigs,
        perturbation=made.perturbation,
        driver=weights.resolve(),
        mix=EXPERT_SHARE,
        round=round_,
        suite=made.suite,
    )
    collect_dataset(settings, folder, scenarios, workers, progress, fresh=False)
