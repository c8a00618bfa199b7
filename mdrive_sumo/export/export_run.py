"""Export the recordings of a run, or any scored recordings, into a new folder."""

from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.export.export_formats import ExportFormat, list_export_formats
from mdrive_sumo.export.log_frame import restore_log_frames
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.runs.recording_check import check_recordings, load_recording
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.scenario.variation import load_varied_scenario
from mdrive_sumo.scoring import ScenarioResult


def export_recordings(recordings: Iterable[ScoredRecording], format_name: str, out: Path) -> Path:
    """Write recordings in a format into `out`, which must be new or an empty folder; return it. Raises InputError."""
    chosen = find_format(format_name)
    writer = chosen.load_writer()
    with atomic_folder(out) as draft:
        writer(_place_in_frame(chosen, recordings), draft)
    return out


def export_runs(runs: Sequence[StoredRun], format_name: str, out: Path, patterns: Sequence[str] = ()) -> Path:
    """Write the recordings of a run in a format into `out`; of several, each into a folder seedN.

    patterns: ids, categories or globs of scenarios; none: all. `out` must be new or an empty folder. Raises InputError.
    """
    form = find_format(format_name)
    writer = form.load_writer()
    chosen = [(stored, select_recorded(stored, patterns)) for stored in runs]
    with atomic_folder(out) as draft:
        for stored, results in chosen:
            folder = draft if len(chosen) == 1 else draft / f"seed{stored.results.run.seed}"
            if len(chosen) > 1:
                folder.mkdir()  # two runs of one seed
            writer(_place_in_frame(form, load_recordings(stored, results)), folder)
    return out


def _place_in_frame(form: ExportFormat, recordings: Iterable[ScoredRecording]) -> Iterable[ScoredRecording]:
    return restore_log_frames(recordings) if form.is_in_log_frame else recordings


def find_format(name: str) -> ExportFormat:
    """Return a format by its name. Raises InputError."""
    formats = list_export_formats()
    if name not in formats:
        raise InputError(f"export: format: expected one of {', '.join(formats)}, found {name!r}")
    return formats[name]


def select_recorded(stored: StoredRun, patterns: Sequence[str] = ()) -> list[ScenarioResult]:
    """Return the results of the chosen scenarios that have recordings, in the order of the run. Raises InputError.

    Void scenarios have none: they are left out, unless they are all that was chosen.
    """
    run = stored.run
    if not run.config.record:
        raise InputError(
            f"{run.folder}: expected a run with recordings, found one made with --no-record;"
            " `mdrive-sumo eval` without that option keeps them"
        )
    names = _select_ids(stored, patterns)
    chosen = [result for result in stored.results.scenarios if result.id in names]
    recorded = [result for result in chosen if result.status != "void"]
    if not recorded:
        reason = f" ({chosen[0].id}: {chosen[0].reason})" if chosen else ""
        raise InputError(
            f"{run.folder}: expected at least one recorded episode, found {len(chosen)} void scenarios{reason}"
        )
    check_recordings(run, [result.key for result in recorded], stored.journal.recordings)
    return recorded


def _select_ids(stored: StoredRun, patterns: Sequence[str]) -> set[str]:
    driven = {result.id for result in stored.results.scenarios}
    if not patterns:
        return driven
    chosen: set[str] = set()
    for pattern in patterns:
        globs = pattern.split(",")
        scenarios = (scenario for scenario in stored.run.scenarios if scenario.id in driven)
        fitting = {
            scenario.id
            for scenario in scenarios
            if any(fnmatchcase(n, g) for g in globs for n in (scenario.id, scenario.category))
        }
        if not fitting:
            raise InputError(_describe_unknown_scenario(stored, pattern, sorted(driven)))
        chosen |= fitting
    return chosen


def _describe_unknown_scenario(stored: StoredRun, pattern: str, driven: Sequence[str]) -> str:
    hint = suggest_name(pattern, driven) or f"; the first is {driven[0]}"
    expected = f"an id, category or glob of its {len(driven)} scenarios"
    return f"{stored.run.folder}: expected {expected}, found {pattern!r}{hint}"


def load_recordings(stored: StoredRun, results: Sequence[ScenarioResult]) -> Iterator[ScoredRecording]:
    """Yield one recording after another, so that a large run does not fill the memory."""
    scenarios = {scenario.id: scenario for scenario in stored.run.scenarios}
    seeds = {result.seed for result in results}
    for result in results:
        record = load_recording(stored.run, result)
        scenario, roads = load_varied_scenario(stored.run.suite, scenarios[result.id], result.seed)
        name = f"{result.id}_seed{result.seed}" if len(seeds) > 1 else result.id
        yield ScoredRecording(record, scenario, roads, result, name)
