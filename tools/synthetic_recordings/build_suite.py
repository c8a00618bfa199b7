"""Build the V2XPnP bucket: `python -m tools.synthetic_recordings --out DIR [--count N] [--seed S] [--dry-run]`.

Synthetic recordings in the V2XPnP format, not the V2XPnP data set: drives in SUMO on two maps of our own are recorded
by CAVs and roadside units, written in the format with its noise (logs and maps stay in OUT.work), and converted like
`mdrive-sumo convert v2xpnp`, except that all logs of a map share one network. More recordings are made than needed;
those whose means come nearest to the paper's table are kept. Recordings in which a CAV cannot arrive are dropped.
"""

import json
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.generate.validation import FULL_SCORE
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.scenario import load_scenario
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, load_suite, save_suite, seal_suite
from tools.synthetic_recordings.candidate_selection import (
    SelectionCandidate,
    build_candidate,
    compute_means,
    select_candidates,
)
from tools.synthetic_recordings.convert_recording import (
    ABOUT,
    RecordingOutcome,
    RecordingTask,
    build_site_network,
    convert_recording,
    record_log,
)
from tools.synthetic_recordings.record_drive import RECORDING_SITES
from tools.tool_command import HELP, ToolCommand, dry_run_option

COUNT = 67
SHARES = {("crossing", 2): 28, ("crossing", 1): 7, ("corridor", 2): 26, ("corridor", 1): 6}
"""Number of the 67 scenarios by map and number of CAVs; 1.81 CAVs per scenario (paper: 1.80)."""
DRIVES_PER_SCENARIO = 2.0
"""Some drives stop at a red light, some are not solvable, and the means must match."""
LIMIT_S = 600.0
R = TypeVar("R")


@click.command(cls=ToolCommand, context_settings=HELP)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="New folder of the suite; logs: OUT.work.")
@click.option("--count", default=COUNT, show_default=True, type=click.IntRange(1), help="Scenarios of the suite.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0))
@click.option("--workers", default=2, show_default=True, type=click.IntRange(1), help="Processes.")
@dry_run_option
def main(out: Path, count: int, seed: int, workers: int, dry_run: bool) -> None:
    """Record drives in SUMO, convert them, and write those that fit as a suite; takes half an hour."""
    if not dry_run:
        build_suite(out, count, seed, workers)
        return
    _check_new(out)
    for (site, cavs), number in split_count(count).items():
        echo(f"{site}, {cavs} CAVs: {number} of {math.ceil(DRIVES_PER_SCENARIO * number)} drives would be kept")


def build_suite(out: Path, count: int, seed: int, workers: int) -> None:
    """Record, convert, select and write; raise InputError."""
    work = _check_new(out)
    wanted = split_count(count)
    tasks = _build_tasks(wanted, seed, work, out)
    logs = {task.name for task, log in _run_all(record_log, tasks, workers) if isinstance(log, Path)}
    ready = _add_networks([task for task in tasks if task.name in logs])
    outcomes = [one for _, one in _run_all(convert_recording, ready, workers) if not isinstance(one, str)]
    write_selection(out, outcomes, {f"{place} {cavs}": number for (place, cavs), number in wanted.items()})


def write_selection(out: Path, outcomes: Sequence[RecordingOutcome], wanted: dict[str, int]) -> None:
    """Select among the converted scenarios, remove the others, complete and seal the suite.

    Scenarios that would fail `mdrive-sumo validate` are dropped; if enough remain, also those in which `omniscient` has
    an infraction.
    """
    found: list[SelectionCandidate] = []
    for group, count in wanted.items():
        here = sorted((one for one in outcomes if one.task.group == group), key=lambda one: one.task.name)
        sound = [one for one in here if not one.examined.problems]
        solved = [one for one in sound if one.examined.omniscient_ds == FULL_SCORE]
        rest = [one for one in sound if one not in solved]
        kept = [*solved, *rest[: max(count - len(solved), 0)]]
        found += [build_candidate(load_scenario(out / one.task.name / SCENARIO_FILE), group) for one in kept]
    chosen = select_candidates(found, wanted)
    for one in outcomes:
        if one.task.name not in {kept.id for kept in chosen}:
            shutil.rmtree(out / one.task.name)
    save_suite(Suite(ABOUT, out, ()))
    save_suite(seal_suite(load_suite(str(out))))
    _print_summary(chosen, outcomes)


def _check_new(out: Path) -> Path:
    """Return the folder of logs and maps; raise InputError if it or `out` exists."""
    work = out.with_name(f"{out.name}.work")
    for folder in (out, work):
        if folder.exists():
            raise InputError(f"{folder}: expected a new folder, found something there")
    return work


def split_count(count: int) -> dict[tuple[str, int], int]:
    """Return the number of scenarios per kind, rounded so that they add up to `count`."""
    exact = {key: share * count / COUNT for key, share in SHARES.items()}
    found = {key: math.floor(number) for key, number in exact.items()}
    for key in sorted(exact, key=lambda key: found[key] - exact[key])[: count - sum(found.values())]:
        found[key] += 1
    return found


def _build_tasks(wanted: dict[tuple[str, int], int], seed: int, work: Path, out: Path) -> list[RecordingTask]:
    """Return all tasks, numbered per map."""
    tasks: list[RecordingTask] = []
    for place in RECORDING_SITES:
        drives = [
            cavs
            for (where, cavs), number in wanted.items()
            if where == place
            for _ in range(math.ceil(DRIVES_PER_SCENARIO * number))
        ]
        tasks += [RecordingTask(place, n, cavs, seed, work, out) for n, cavs in enumerate(drives)]
    return tasks


def _add_networks(tasks: Sequence[RecordingTask]) -> list[RecordingTask]:
    """Return the tasks with the network of their map."""
    found: list[RecordingTask] = []
    for place in RECORDING_SITES:
        here = [task for task in tasks if task.place == place]
        if here:
            network = build_site_network(here)
            found += [replace(task, network=network) for task in here]
    return found


def _run_all(
    function: Callable[[RecordingTask], R | str], tasks: Sequence[RecordingTask], workers: int
) -> Iterator[tuple[RecordingTask, R | str]]:
    """Yield the result of every task as it finishes; report progress on standard error."""
    with ProcessPool(function, workers, LIMIT_S) as pool:
        for n, (task, answer) in enumerate(pool.run(tasks), 1):
            message = answer.reason if isinstance(answer, WorkerFailure) else answer if isinstance(answer, str) else ""
            echo(f"{function.__name__} {n}/{len(tasks)} {task.name} {message}", err=True)
            yield task, message if isinstance(answer, WorkerFailure) else answer


def _print_summary(chosen: Sequence[SelectionCandidate], outcomes: Sequence[RecordingOutcome]) -> None:
    """Print the means and the results of the baselines on standard output."""
    kept = [one for one in outcomes if one.task.name in {other.id for other in chosen}]
    length, turned, actors = compute_means(chosen).tolist()
    about = {
        "scenarios": len(chosen),
        "mean_cavs": round(sum(one.cavs for one in chosen) / len(chosen), 3),
        "mean_route_m": round(length, 2),
        "mean_heading_change_deg": round(turned, 2),
        "mean_actors": round(actors, 2),
        "converted": len(outcomes),
        "not_sound_or_solvable": {one.task.name: one.examined.problems for one in outcomes if one.examined.problems},
        "below_a_target": {one.task.name: one.misses for one in kept if one.misses},
        "omniscient_without_infraction": sum(one.examined.omniscient_ds == FULL_SCORE for one in kept),
        "hidden_until_late": sum(one.examined.is_occluded for one in kept),
    }
    echo(json.dumps(about, indent=1))
