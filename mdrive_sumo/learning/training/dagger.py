"""train_in_rounds: DAgger (Ross et al., 2011): the learner drives, the expert says what it would have done there."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.output_files import copy_file
from mdrive_sumo.learning.training.checkpoint import CHECKPOINT_NAME, load_checkpoint
from mdrive_sumo.learning.training.export_network import export_network
from mdrive_sumo.learning.training.run_training import Arrays, Report, TrainingRun, run_training

LATER_RATE = 0.5
"""Factor on the learning rate in rounds after the first: they begin with trained weights."""


@dataclass(frozen=True, slots=True)
class DaggerData:
    """Where rounds get their data from."""

    folders: tuple[Path, ...]
    """What the first round is trained on."""
    collect: Callable[[int, Path, Path], None]
    """Drive with weights (round, path of the .onnx file) and write a data set into a folder."""
    load: Callable[[tuple[Path, ...]], Arrays]
    """All samples of data sets."""


def train_in_rounds(run: TrainingRun, data: DaggerData, rounds: int, report: Report) -> Path:
    """Train, let the learner drive, train on everything so far, ...; returns the path of the last checkpoint.

    Round r is written to DIR/round-r, its data to DIR/round-r/data; a resumed run goes on with the last one begun.
    """
    folders = data.folders
    checkpoint = run.initial
    for number in range(rounds):
        folder = name_round(run.folder, number)
        options = run.options
        if number:
            assert checkpoint is not None
            options = replace(options, learning_rate=LATER_RATE * options.learning_rate)
            weights = export_network(load_checkpoint(checkpoint, run.system), folder / "driver").network
            report(f"round {number}: {weights} drives")
            data.collect(number, weights, folder / "data")
            folders = (*folders, folder / "data")
        part = replace(
            run, options=options, folder=folder, data=data.load(folders), initial=checkpoint, sources=_name(folders)
        )
        checkpoint = run_training(part, report)
    assert checkpoint is not None
    final = run.folder / CHECKPOINT_NAME
    copy_file(checkpoint, final)
    return final


def name_round(folder: Path, number: int) -> Path:
    """Return the folder of a round in that of the training."""
    return folder / f"round-{number}"


def _name(folders: tuple[Path, ...]) -> tuple[str, ...]:
    return tuple(str(folder) for folder in folders)
