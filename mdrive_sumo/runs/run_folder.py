"""Run folders: find and list them, say what is wrong with one, load the results of a run that may be going on.

Readers take no lock and write nothing, so a run that is going on is never held up.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import check_tree
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.journal import JOURNAL_FILE, JournalText, find_entry_key, read_run_journal
from mdrive_sumo.runs.run_config import RUNS_FOLDER
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, load_results, load_unchecked_results, summarize_run
from mdrive_sumo.scoring.results_check import find_result_faults

MAX_DEPTH = 4
"""Folders below which runs are looked for: those of a study lie at RUNS/AGENT/CONDITION/SEED."""


@dataclass(frozen=True, slots=True)
class ListedRun:
    """A run folder, with its results if it is finished."""

    folder: Path
    fingerprint: Mapping[str, Any]
    finished: int
    """Episodes that have a result."""
    planned: int
    """Episodes of the whole run; 0 if its journal does not say."""
    results: Results | None
    problem: str = ""
    """Why it cannot be read; "" if it can."""


def list_runs(root: Path = RUNS_FOLDER) -> Iterator[ListedRun]:
    """Yield the run folders below a folder, and the folder itself if it is one, sorted by path."""
    for folder in sorted(find_run_folders(root)):
        yield _read_run(folder)


def find_run_folders(root: Path, depth: int = MAX_DEPTH) -> Iterator[Path]:
    """Yield the folders with a journal, not deeper than `depth`; no run lies in another, and links are left out."""
    if (root / JOURNAL_FILE).is_file():
        yield root
        return
    if depth == 0 or not root.is_dir():
        return
    for path in root.iterdir():
        if path.is_dir() and not path.is_symlink():
            yield from find_run_folders(path, depth - 1)


def describe_missing_run(folder: Path) -> str:
    """Return a sentence about a folder that is no run: the one that was probably meant, and how to list them."""
    runs = [str(path) for path in find_run_folders(RUNS_FOLDER)]
    names = {Path(path).name: path for path in runs} | {path: path for path in runs}
    suggestion = suggest_name(str(folder), names)
    meant = next((path for name, path in names.items() if f"{name!r}?" in suggestion), "")
    remedy = f"`mdrive-sumo list runs` lists the {len(runs)} below {RUNS_FOLDER}/"
    where = f"; did you mean {meant!r}?" if meant else f"; {remedy if runs else '`mdrive-sumo eval` makes one'}"
    found = "one without a run" if folder.is_dir() else "no such folder"
    return f"run {str(folder)!r}: expected a folder that `mdrive-sumo eval` has written, found {found}{where}"


def check_run_folder(folder: Path, *, may_be_unfinished: bool = False) -> None:
    """Raise InputError for a folder that holds no finished run, or more than regular files, and say what to do.

    Every reader of a run calls it first. may_be_unfinished: a journal is enough.
    """
    if (folder / RESULTS_FILE).exists() or (folder / JOURNAL_FILE).exists():
        check_tree(folder)
    has_journal = (folder / JOURNAL_FILE).is_file()
    if (folder / RESULTS_FILE).is_file() or (has_journal and may_be_unfinished):
        return
    if has_journal:
        raise InputError(
            f"run {str(folder)!r}: expected a finished run, found an interrupted one; the same `mdrive-sumo eval`"
            " command continues it"
        )
    raise InputError(describe_missing_run(folder))


def _read_run(folder: Path) -> ListedRun:
    try:
        check_tree(folder)
        fingerprint, journal = read_run_journal(folder)
        finished = len({(str(entry.get("id")), entry.get("seed")) for entry in journal.results})
        path = folder / RESULTS_FILE
        results = load_unchecked_results(path) if path.is_file() else None
        planned = journal.about.get("episodes", 0)
        return ListedRun(folder, fingerprint, finished, planned if isinstance(planned, int) else 0, results)
    except InputError as error:
        return ListedRun(folder, {}, 0, 0, None, str(error))


def load_run_results(folder: Path) -> Results:
    """Return the results of a finished run, or those of the episodes that an unfinished one has finished.

    Raises InputError for a folder without a run, a run of which no episode is finished, and corrupt files.
    """
    check_run_folder(folder, may_be_unfinished=True)
    if (folder / RESULTS_FILE).is_file():
        return load_results(folder / RESULTS_FILE)
    return build_partial_results(folder, read_run_journal(folder)[1])


def build_partial_results(folder: Path, journal: JournalText) -> Results:
    """Return the results of the episodes in a journal, marked as partial. Raises InputError."""
    path = folder / JOURNAL_FILE
    about = journal.about
    entries = [*{find_entry_key(entry): entry for entry in journal.results}.values()]
    try:
        info, planned = RunInfo.model_validate(about["run"]), int(about["episodes"])
        scenarios = [ScenarioResult.model_validate(entry) for entry in entries]
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}; --fresh starts anew") from None
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: expected the description of a run, found a corrupt one ({error})") from None
    if not scenarios:
        raise InputError(f"run {str(folder)!r}: expected at least one finished episode, found 0 of {planned}")
    results = summarize_run(info, scenarios).model_copy(update={"planned": planned})
    for fault in find_result_faults(results):
        raise InputError(f"{path}: {fault}; --fresh starts anew")
    return results
