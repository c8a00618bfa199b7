"""`mdrive-sumo learn train`."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.agents.learned.system_spec import PLAN_HEADS, SYSTEMS
from mdrive_sumo.cli.options import FiniteRange, workers_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.require_torch import require_torch
from mdrive_sumo.learning.sample_format import PLACES_FOLDER

FOLDER = click.Path(path_type=Path, file_okay=False)


@dataclass(frozen=True, slots=True)
class RoundOptions:
    """Options of DAgger."""

    rounds: int
    scenarios: int
    places: Path
    workers: int


@click.command("train")
@click.argument("system", type=click.Choice(tuple(SYSTEMS)))
@click.option("--data", multiple=True, type=FOLDER, help="Data set of `learn data`; may repeat.")
@click.option("--val", multiple=True, type=FOLDER, help="Data set to validate on  [default: one place of 20 of --data]")
@click.option(
    "--plan-head",
    type=click.Choice(PLAN_HEADS),
    default=PLAN_HEADS[0],
    show_default=True,
    help="How the network answers a plan: its points, or scores of fixed trajectories.",
)
@click.option("--device", type=click.Choice(("cuda", "cpu")), default="cuda", show_default=True)
@click.option("--out", type=FOLDER, required=True, help="Folder for checkpoint, curves and validation.")
@click.option("--steps", type=click.IntRange(1, 10_000_000), default=8000, show_default=True)
@click.option("--batch", type=click.IntRange(1, 65_536), default=256, show_default=True, help="Samples of one step.")
@click.option("--learning-rate", type=FiniteRange(1e-7, 1.0), default=1e-3, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True)
@click.option(
    "--max-minutes", type=FiniteRange(0.01, 1e5), help="End by then, with the learning rate run out; each round."
)
@click.option("--resume", is_flag=True, help="Go on from the checkpoint in --out.")
@click.option(
    "--init", type=click.Path(path_type=Path), metavar="CHECKPOINT", help="Begin with the weights of another training."
)
@click.option("--rounds", type=click.IntRange(1, 100), default=1, show_default=True, help="Of DAgger; 1: --data only.")
@click.option(
    "--scenarios", type=click.IntRange(1, 1_000_000), default=200, show_default=True, help="Driven in each later round."
)
@click.option("--places", type=FOLDER, help="Places of these scenarios.  [default: places, beside the first --data]")
@workers_option
@click.option("--smoke", is_flag=True, help="50 steps on 20 samples (made up without --data), exit 1 unless they help.")
def command(system: str, smoke: bool, data: tuple[Path, ...], out: Path, **options: Any) -> None:
    """Train a system on data of `learn data`, and validate it.

    Writes checkpoint.pt, weights.pt, curves.csv, curves.png, validation.json, and a folder for TensorBoard if it is
    installed (--smoke: into OUT/smoke). Needs the extra `learn`.
    """
    require_torch("learn train")
    if smoke:
        _run_smoke_test(system, data, out, options)
        return
    if not data:
        raise click.UsageError("--data: expected at least one data set of `learn data`, found none")
    try:
        _train(system, data, out, options)
    except KeyboardInterrupt:
        where = "--resume goes on with" if _is_begun(out) else "nothing is kept in"
        echo(f"interrupted; {where} {out}", err=True)
        raise click.exceptions.Exit(130) from None


def _is_begun(out: Path) -> bool:
    """Return whether a folder holds a training, in rounds or not."""
    from mdrive_sumo.learning.training.checkpoint import CHECKPOINT_NAME

    return any((folder / CHECKPOINT_NAME).is_file() for folder in _list_starts(out))


def _list_starts(out: Path) -> tuple[Path, Path]:
    """Return the folders of a training: without rounds, and of the first round."""
    from mdrive_sumo.learning.training.dagger import name_round

    return out, name_round(out, 0)


def _run_smoke_test(system: str, data: tuple[Path, ...], out: Path, options: dict[str, Any]) -> None:
    from mdrive_sumo.learning.training.smoke_test import COMPARED, STEPS, run_smoke_test

    arrays = _load(system, data, options["workers"]) if data else None
    found = run_smoke_test(system, out / "smoke", arrays, options["plan_head"])
    echo(
        f"{system}: mean loss of the first {COMPARED} of {STEPS} steps {found.first:.3f}, of the last {found.last:.3f}"
    )
    if not found.is_lower:
        echo("the loss did not fall", err=True)
        raise click.exceptions.Exit(1)


def _load(system: str, folders: tuple[Path, ...], workers: int) -> dict[str, Any]:
    from mdrive_sumo.learning.sample_reader import load_arrays

    began = time.monotonic()
    arrays = load_arrays(folders, SYSTEMS[system], workers)
    gigabytes = sum(each.nbytes for each in arrays.values()) / 1e9
    echo(f"{len(arrays['own'])} samples, {gigabytes:.1f} GB, read in {time.monotonic() - began:.0f} s")
    return arrays


def _train(system: str, data: tuple[Path, ...], out: Path, options: dict[str, Any]) -> None:
    from mdrive_sumo.learning.held_out import check_apart
    from mdrive_sumo.learning.training.checkpoint import check_unused
    from mdrive_sumo.learning.training.run_training import TrainingRun, find_device, run_training
    from mdrive_sumo.learning.training.training_options import TrainingOptions

    find_device(options["device"])  # before the data is read
    check_apart(data, options["val"])
    if not options["resume"]:
        for folder in _list_starts(out):
            check_unused(folder)
    elif not _is_begun(out):
        raise InputError(f"--resume: expected a training to go on with in {out}, found none")
    places = options["places"] or data[0].parent / PLACES_FOLDER
    rounds = RoundOptions(options["rounds"], options["scenarios"], places, options["workers"])
    training = TrainingOptions(
        steps=options["steps"], batch=options["batch"], learning_rate=options["learning_rate"], seed=options["seed"],
        max_minutes=options["max_minutes"], plan_head=options["plan_head"],
    )  # fmt: skip
    run = TrainingRun(
        system=system, options=training, device=options["device"], folder=out,
        data=_load(system, data, rounds.workers) if rounds.rounds == 1 else {},
        validation=_load(system, options["val"], rounds.workers) if options["val"] else None,
        is_resumed=options["resume"], initial=options["init"], sources=tuple(map(str, data)),
    )  # fmt: skip
    path = run_training(run, echo) if rounds.rounds == 1 else _train_in_rounds(run, data, rounds)
    echo(f"{path}  `learn export {system} --checkpoint {path} --out DIR` makes weights to drive with")


def _train_in_rounds(run: Any, data: tuple[Path, ...], rounds: RoundOptions) -> Path:
    from mdrive_sumo.cli.learn_data import CollectionDisplay
    from mdrive_sumo.learning.collection import RoundPlan, collect_round
    from mdrive_sumo.learning.training.dagger import DaggerData, train_in_rounds

    plan = RoundPlan(data[0], rounds.places, rounds.scenarios, rounds.workers)
    sources = DaggerData(
        data,
        lambda number, weights, folder: collect_round(plan, number, weights, folder, CollectionDisplay()),
        lambda folders: _load(run.system, folders, rounds.workers),
    )
    return train_in_rounds(run, sources, rounds.rounds, echo)
