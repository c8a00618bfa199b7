"""Draw the V2XPnP bucket of a season: the entry point `v2xpnp` in `mdrive_sumo.season_buckets`.

Synthetic recordings in the V2XPnP format, not the V2XPnP data set: drives in SUMO at drawn places are recorded by CAVs
and road-side units, written in the format with its noise, and converted like `mdrive-sumo convert v2xpnp`, except that
all logs of a place share one network. Many more recordings are made than needed. Those are dropped in which the log's
CAVs have an infraction or `omniscient` has one; agents drive the others, and a program chooses by means and scores.
"""

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import copy_file, make_folder
from mdrive_sumo.generate.seasons.season_bucket import BucketRequest
from mdrive_sumo.generate.selection import SelectionItem
from mdrive_sumo.runs.journal import Journal, open_journal
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, load_suite, save_suite, seal_suite
from real2sim.network import NetworkReport
from real2sim.recorded_drives.choose_recordings import choose_recordings
from real2sim.recorded_drives.convert_recording import (
    NETWORKS,
    SUITE,
    RecordingOutcome,
    RecordingTask,
    build_site_network,
    convert_recording,
    record_log,
)
from real2sim.recorded_drives.recording_site import draw_sites

DRIVES_PER_SCENARIO = 6.0
"""Of 152 drives of trials at 15 places 95 were recorded, in most others a CAV waits; of 81 conversions 53 were of use,
with times of those who cross that were not yet the present ones."""
LONE_SHARE = 0.15
"""Share of drives with one CAV, the others have two (paper: 1.80 on average): more of these are dropped."""
LIMIT_S = 600.0
"""Wall clock for a drive or a conversion, which take seconds: it ends what hangs."""
R = TypeVar("R")


def draw_bucket(request: BucketRequest) -> None:
    """Record, convert, select and write; raise InputError."""
    with open_journal(request.work, request.fingerprint, fresh=False) as journal:
        known = {str(line["id"]): line for line in journal.results}
        tasks = _build_tasks(request)
        logs = _run_all(record_log, "log", tasks, request, journal, known)
        recorded = [task for task in tasks if logs[task.name] == ""]
        ready = _add_networks(recorded, request)
        found = _run_all(convert_recording, "scenario", ready, request, journal, known)
    outcomes = [one for one in map(_read_outcome, found.values()) if one is not None]
    _write_selection(request, outcomes)


def _build_tasks(request: BucketRequest) -> list[RecordingTask]:
    """Return all tasks: the drives go round the places."""
    sites = draw_sites(request.seed.derive("v2xpnp", "places"), request.work / "places")
    seed = int(request.seed.derive("v2xpnp", "drives")[:12], 16)
    rng = random.Random(seed)
    return [
        RecordingTask(sites[n % len(sites)], n, 1 if rng.random() < LONE_SHARE else 2, seed, request.work)
        for n in range(math.ceil(DRIVES_PER_SCENARIO * request.count))
    ]


def _add_networks(tasks: Sequence[RecordingTask], request: BucketRequest) -> list[RecordingTask]:
    """Return the tasks with the network of their place, without those of places of which none can be built."""
    by_place: dict[Path, list[RecordingTask]] = {}
    for task in tasks:
        by_place.setdefault(task.site.network, []).append(task)
    with ProcessPool[list[RecordingTask], NetworkReport | str](build_site_network, request.workers, LIMIT_S) as pool:
        networks: dict[Path, NetworkReport] = {}
        for group, report in pool.run(list(by_place.values())):
            place = group[0].site.network
            if isinstance(report, WorkerFailure):
                raise InputError(f"network of {place.name}: expected one, found none: {report.reason}")
            if isinstance(report, str):
                request.note(f"v2xpnp: place {place.name} is left out, it has no network: {report}")
            else:
                networks[place] = report
    return [replace(task, network=networks[task.site.network]) for task in tasks if task.site.network in networks]


def _run_all(
    function: Callable[[RecordingTask], R],
    stage: str,
    tasks: Sequence[RecordingTask],
    request: BucketRequest,
    journal: Journal,
    known: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:
    """Return the result of every task by name, from the journal where it holds it: JSON values."""
    found = {task.name: known[f"{stage}/{task.name}"]["value"] for task in tasks if f"{stage}/{task.name}" in known}
    missing = [task for task in tasks if task.name not in found]
    with ProcessPool[RecordingTask, R](function, request.workers, LIMIT_S) as pool:
        for n, (task, answer) in enumerate(pool.run(missing), 1):
            if isinstance(answer, WorkerFailure):
                if answer.kind is FailureKind.INPUT:
                    raise InputError(answer.reason)
                value: Any = answer.reason
            else:
                value = asdict(answer) if isinstance(answer, RecordingOutcome) else answer
            journal.add_result({"id": f"{stage}/{task.name}", "value": value})
            found[task.name] = value
            request.note(f"{stage} {n}/{len(missing)}  v2xpnp/{task.name} {value if isinstance(value, str) else ''}")
    return {task.name: found[task.name] for task in tasks}


def _read_outcome(value: Any) -> RecordingOutcome | None:
    """Return the outcome that the journal holds; None for a recording that could not be converted."""
    if isinstance(value, str):
        return None
    return RecordingOutcome(**value | {"item": SelectionItem(**value["item"])})


def _write_selection(request: BucketRequest, outcomes: Sequence[RecordingOutcome]) -> None:
    """Choose among the sound scenarios and write the sealed suite."""
    pool = [one for one in outcomes if not one.problems]
    if len(pool) < request.count:
        raise InputError(f"v2xpnp: expected {request.count} sound scenarios, found {len(pool)}")
    chosen = [one.item for one in choose_recordings(pool, request.count)]
    source = request.work / SUITE
    for item in chosen:
        copy_file(source / item.id / SCENARIO_FILE, make_folder(request.folder / item.id) / SCENARIO_FILE)
    for name in sorted({item.network for item in chosen}):
        for path in sorted((source / NETWORKS / name).iterdir()):
            copy_file(path, make_folder(request.folder / NETWORKS / name) / path.name)
    save_suite(Suite(request.about, request.folder, ()))
    save_suite(seal_suite(load_suite(str(request.folder))))
