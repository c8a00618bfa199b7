"""collect_round: data of one round of DAgger, made as the data set that the first round was trained on."""

from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.learning.collection import CollectionProgress, collect_dataset
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.shard_reading import load_dataset_file

EXPERT_SHARE = 0.2
"""Of the segments of a drive, as `learn data --mix`."""


@dataclass(frozen=True, slots=True)
class RoundPlan:
    """How much each round drives, and as what."""

    first: Path
    """Data set whose split, seed, expert, rigs and perturbation are used again."""
    scenarios: int
    workers: int


def collect_round(plan: RoundPlan, round_: int, weights: Path, folder: Path, progress: CollectionProgress) -> None:
    """Let weights (.onnx) drive the scenarios of a round and write the samples into a folder. Raises InputError."""
    made = load_dataset_file(plan.first)
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
    collect_dataset(settings, folder, plan.scenarios, plan.workers, progress, fresh=False)
