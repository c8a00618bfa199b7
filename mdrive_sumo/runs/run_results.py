"""The results of a run folder, also while the run goes on or after it was interrupted: then those of its journal.

Readers take no lock and write nothing, so a run that is going on is never held up.
"""

from pathlib import Path

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.journal import JOURNAL_FILE, JournalText, find_entry_key, read_run_journal
from mdrive_sumo.runs.run_listing import check_run_folder
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult, load_results, summarize_run
from mdrive_sumo.scoring.results_check import find_result_faults


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
