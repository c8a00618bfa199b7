"""A data set of demonstrations from takes: `export --demonstrations`. Only ticks in which a person drove are in it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from mdrive_sumo.contract import Objects, Observation
from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.demonstration_tables import (
    OBJECTS,
    ROUTES,
    STEPS,
    TABLES,
    TAKES,
    TEXTS,
    DemonstratedTick,
    Rows,
    build_objects,
    build_route,
    build_step,
    build_texts,
)
from mdrive_sumo.export.export_formats import EXPORT_FORMATS
from mdrive_sumo.export.export_run import select_recorded
from mdrive_sumo.export.table_files import TableParts
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.runs.run_folder import describe_missing_run, find_run_folders
from mdrive_sumo.runs.stored_run import StoredRun, load_stored_run
from mdrive_sumo.runs.takes import ObservedTake, RecordedActions, is_take, observe_take
from mdrive_sumo.scoring import ScenarioResult

WRITERS = {
    "csv": "mdrive_sumo.export.table_files:write_csv_tables",
    "parquet": "mdrive_sumo.export.parquet_tables:write_parquet_tables",
}
"""Writers of tables by format."""
Known = set[tuple[str, int, str, bytes]]
"""Scenario, seed, CAV and digest of the ticks that the data set has: takes share those before a branch."""


@dataclass
class _PersonTicks:
    """The ticks of a CAV that a person drives, shown one after the other."""

    wanted: frozenset[int]
    ticks: list[DemonstratedTick] = field(default_factory=list[DemonstratedTick])

    def add(self, tick: int, seen: Observation) -> None:
        if tick in self.wanted:
            objects = Objects.empty() if seen.objects is None else seen.objects
            self.ticks.append(DemonstratedTick(tick, seen, objects))


def load_takes(folder: Path, suite: str | None = None) -> list[StoredRun]:
    """Return the takes in a folder: a run folder, or one that holds runs, of which others than takes are left out.

    Raises InputError without any take.
    """
    folders = sorted(find_run_folders(folder), key=_order_folder)
    if not folders:
        raise InputError(describe_missing_run(folder))
    stored = [load_stored_run(one, suite) for one in folders]
    takes = [one for one in stored if is_take(one.run.config.agent)]
    if not takes:
        names = ", ".join(sorted({one.run.config.agent.name for one in stored})[:3])
        raise InputError(f"{folder}: expected a take, which a person drives, found runs of {names} only")
    return takes


def _order_folder(folder: Path) -> tuple[Path, int, str]:
    """Return the order of run folders: takes are numbered."""
    return folder.parent, int(folder.name) if folder.name.isdecimal() else -1, folder.name


def export_demonstrations(
    takes: Sequence[StoredRun], format_name: str, out: Path, patterns: Sequence[str] = ()
) -> Path:
    """Write the data set into `out`, which must be new or an empty folder; return it.

    Every take is driven again, because recordings do not hold what was seen, and must be what was recorded.
    Raises InputError, also if no person drove in any of them.
    """
    writer = _load_writer(format_name)
    chosen = [(stored, result) for stored in takes for result in select_recorded(stored, patterns)]
    with atomic_folder(out) as draft:
        parts = _Counted(_build_all(chosen))
        writer(TABLES, parts, draft)
        if not parts.count:
            raise InputError(f"{takes[0].run.folder}: expected ticks in which a person drives, found none")
    return out


def _load_writer(format_name: str) -> Callable[..., None]:
    if format_name not in WRITERS:
        raise InputError(
            f"export --demonstrations: --format: expected one of {', '.join(WRITERS)}, found {format_name!r:.40}"
        )
    EXPORT_FORMATS[format_name].load_writer()  # says which package is missing
    module, _, function = WRITERS[format_name].partition(":")
    return getattr(import_module(module), function)


class _Counted:
    """The parts of a data set, and how many there were."""

    def __init__(self, parts: Iterable[TableParts]) -> None:
        self._parts, self.count = parts, 0

    def __iter__(self) -> Iterator[TableParts]:
        for part in self._parts:
            self.count += 1
            yield part


def _build_all(chosen: Iterable[tuple[StoredRun, ScenarioResult]]) -> Iterator[TableParts]:
    """Yield the tables of one CAV after another."""
    known: Known = set()
    for stored, result in chosen:
        record = load_recording(stored.run, result)
        wanted = {ego: select_new_ticks(record, result, ego, known) for ego in record.ego_ids}
        if not any(ticks for ticks, _ in wanted.values()):
            continue
        scenario = next(one for one in stored.run.scenarios if one.id == result.id)
        shown = {ego: _PersonTicks(ticks) for ego, (ticks, _) in wanted.items() if ticks}
        job = stored.run.make_job(scenario, result.seed)
        take = observe_take(job, record, partial(_show, shown))
        for ego, one in shown.items():
            yield _build_cav(stored, result, take, ego, one.ticks, wanted[ego][1])


def _show(shown: Mapping[str, _PersonTicks], tick: int, observations: Mapping[str, Observation]) -> None:
    for ego, one in shown.items():
        if ego in observations:
            one.add(tick, observations[ego])


def select_new_ticks(
    record: EpisodeRecord, result: ScenarioResult, ego: str, known: Known
) -> tuple[frozenset[int], int]:
    """Return the ticks in which a person drove a CAV and that are new, and how many are not. Adds to `known`."""
    driven = RecordedActions(record, ego).list_person_ticks()
    keys = {tick: (result.id, result.seed, ego, record.digests[tick].tobytes()) for tick in driven}
    new = frozenset(tick for tick, key in keys.items() if key not in known)
    known.update(keys.values())
    return new, len(driven) - len(new)


def _build_cav(
    stored: StoredRun, result: ScenarioResult, take: ObservedTake, ego: str, ticks: Sequence[DemonstratedTick], old: int
) -> TableParts:
    """Return the rows of all tables for one CAV of a take. old: ticks that another take has."""
    key = (result.id, result.seed, take.record.digest, ego)
    route = Polyline(take.briefings[ego].route_xy)
    config, score = stored.run.config.agent.config, next(one for one in result.egos if one.id == ego)
    about = (
        *(stored.run.folder.name, str(config.get("device", "")), float(config.get("latency_ms", 0.0)), len(ticks), old),
        *(str(score.outcome), score.reason, score.ds, score.rc, score.ip),
    )
    rows: dict[str, Rows] = {
        TAKES.name: [(*key, *about)],
        STEPS.name: [(*key, one.tick, *build_step(take, ego, route, one)) for one in ticks],
        OBJECTS.name: [(*key, one.tick, *row) for one in ticks for row in build_objects(take, one)],
        TEXTS.name: [(*key, one.tick, *row) for one in ticks for row in build_texts(take, ego, one)],
        ROUTES.name: [(*key, *row) for row in build_route(take.briefings[ego])],
    }
    return {table.name: _transpose(rows[table.name], [column.name for column in table.columns]) for table in TABLES}


def _transpose(rows: Rows, names: Sequence[str]) -> dict[str, Sequence[Any]]:
    """Return the values of each column."""
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}
