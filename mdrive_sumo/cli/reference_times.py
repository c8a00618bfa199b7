"""`mdrive-sumo reference-times`."""

from collections.abc import Mapping
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.stored_run import StoredRun, load_stored_run
from mdrive_sumo.scenario.reference_times import (
    REFERENCE_AGENT,
    REFERENCE_SEED,
    REFERENCE_TIMES_FILE,
    save_reference_times,
)
from mdrive_sumo.scoring import find_arrival_ticks
from mdrive_sumo.study.occlusion_certificate import REFERENCE_OPTIONS


@click.command("reference-times")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
def command(run_folder: Path) -> None:
    """Write when `omniscient` arrived, for time ratio and efficient SR.

    RUN is a folder of `eval --suite SUITE --agent omniscient --ids scenario --sensing perfect` with seed 0, of all
    scenarios or some (--scenario). Their times are written to reference_times.json beside the suite, or each of its
    parts; the times of other scenarios are kept. `validate SUITE --write` does the same and drives by itself.
    """
    stored = load_stored_run(run_folder)
    _check_reference_run(stored, run_folder)
    times = {result.id: find_arrival_ticks(result.egos) for result in stored.results.scenarios if result.status == "ok"}
    for part in stored.run.suite.parts or (stored.run.suite,):
        if not any(scenario.id in times for scenario in part.scenarios):
            continue
        path = part.folder / REFERENCE_TIMES_FILE
        with report_write_errors(path):
            count = save_reference_times(part, times)
        echo(f"{path}  times of {count} scenarios")


def _check_reference_run(stored: StoredRun, folder: Path) -> None:
    """Raise InputError for a run that no reference is taken from."""
    config = stored.run.config
    expected: Mapping[str, object] = {
        "agent": REFERENCE_AGENT,
        "agent_config": "{}",
        "seed": REFERENCE_SEED,
        **REFERENCE_OPTIONS.to_dict(),
    }
    identity = config.to_dict()
    for name, value in expected.items():
        if identity[name] != value:
            raise InputError(f"{folder}: {name}: expected a run with {value!r}, found {identity[name]!r}")
    if config.has_many_seeds:
        raise InputError(f"{folder}: seeds: expected a run with seed {REFERENCE_SEED} alone, found one of several")
    if any(ego.ticks is None for result in stored.results.scenarios for ego in result.egos):
        raise InputError(
            f"{folder}: expected results with the ticks of every CAV, found those of an older version;"
            " drive it again with --fresh"
        )
