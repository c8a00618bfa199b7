"""StoredRun: a run in its folder, loaded again for `verify`, `rescore`, `show` and `view`."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.fingerprint import (
    FILES_KEYS,
    PLUG_INS_KEY,
    compute_code_checksum,
    compute_networks_checksum,
    hash_option_files,
    identify_run_plug_ins,
    read_versions,
)
from mdrive_sumo.runs.journal import JOURNAL_FILE, JournalText, read_run_journal
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.run_folder import build_partial_results, check_run_folder
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results, load_results, load_unchecked_results


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run with its results; those of a run that is not finished are marked as partial."""

    run: PreparedRun
    results: Results
    journal: JournalText

    def describe_version_changes(self) -> str:
        """Return what differs between the run and this installation, as far as results depend on it; "" if nothing."""
        networks = compute_networks_checksum(self.run.suite, self.run.scenarios)
        now = read_versions(self.run.config.agents) | {"code": compute_code_checksum(), "networks": networks}
        then = self.run.fingerprint
        changes = [
            name if name in ("code", "networks") else f"{name} {then.get(name)}"
            for name in now
            if now[name] != then.get(name)
        ]
        files = hash_option_files(self.run.config)
        if any(key in then and then[key] != files.get(key) for key in FILES_KEYS):
            changes.append("file that an option of the agent names")
        if (then.get(PLUG_INS_KEY) or "{}") != json.dumps(identify_run_plug_ins(self.run.config)):
            changes.append("set of plug-ins")
        return ", ".join(changes)


def load_stored_run(folder: Path, suite: str | None = None) -> StoredRun:
    """Load a run's configuration and results. suite: the suite's place now if it has moved. Raises InputError.

    Also refused are results that cannot be: see `load_results`.
    """
    stored = load_unchecked_run(folder, suite)
    results = load_results(folder / RESULTS_FILE)
    _check_scenarios(folder / RESULTS_FILE, stored.run, results)
    return replace(stored, results=results)


def load_viewed_run(folder: Path, suite: str | None = None) -> StoredRun:
    """As `load_stored_run`, also of a run that is going on or was interrupted, with what it has finished.

    Its results are then marked as partial. Raises InputError, also if nothing is finished yet.
    """
    check_run_folder(folder, may_be_unfinished=True)
    if (folder / RESULTS_FILE).is_file():
        return load_stored_run(folder, suite)
    fingerprint, journal = read_run_journal(folder)
    return _load_run(folder, suite, build_partial_results(folder, journal), (fingerprint, journal))


def load_unchecked_run(folder: Path, suite: str | None = None) -> StoredRun:
    """As `load_stored_run`, with results of any content: for `verify`, which compares every number."""
    check_run_folder(folder)
    results = load_unchecked_results(folder / RESULTS_FILE)
    if not results.scenarios:
        raise InputError(f"{folder / RESULTS_FILE}: scenarios: expected at least one, found none")
    return _load_run(folder, suite, results, read_run_journal(folder))


def _load_run(
    folder: Path, suite: str | None, results: Results, journaled: tuple[dict[str, Any], JournalText]
) -> StoredRun:
    fingerprint, journal = journaled
    try:
        config = RunConfig.from_journal(fingerprint, folder)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{folder / JOURNAL_FILE}: expected the fingerprint of a run, found a corrupt one ({error})"
        ) from None
    if suite is None and Path(config.suite).is_absolute() and not Path(config.suite).is_dir():
        raise InputError(
            f"{folder}: expected the run's suite at {config.suite}, found no folder; --suite DIR says where it is now"
        )
    loaded = load_suite(suite or config.suite)
    if loaded.checksum() != results.run.suite_checksum:
        raise InputError(
            f"suite {loaded.label}: expected the checksum of {folder}, {results.run.suite_checksum},"
            f" found {loaded.checksum()}"
        )
    scenarios = loaded.select(config.scenario)
    return StoredRun(PreparedRun(config, loaded, scenarios, folder, results.run, fingerprint), results, journal)


def _check_scenarios(path: Path, run: PreparedRun, results: Results) -> None:
    """Raise InputError unless the results are those of the episodes that the run drives."""
    expected, found = [*run.episodes], [run.find_key(result) for result in results.scenarios]
    missing, foreign = sorted({*expected} - {*found}), sorted({*found} - {*expected})
    if missing or foreign:
        name = run.name_episode((missing or foreign)[0])
        what = f"{name!r} {'missing' if missing else 'too many'}"
        raise InputError(
            f"{path}: scenarios: expected the {len(expected)} that {run.config.scenario!r} selects, found"
            f" {len(found)}, {what}"
        )
