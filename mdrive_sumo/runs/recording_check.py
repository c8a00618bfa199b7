"""Compare recordings with the checksums that the journal notes."""

from collections.abc import Iterable, Mapping

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import EpisodeKey, ScenarioResult

MAX_SHOWN = 80
"""Characters of names in a sentence."""
RESULTS_NAME = "results.json"


def load_recording(run: PreparedRun, result: ScenarioResult) -> EpisodeRecord:
    """Return the recording of a result. Raises InputError for one that is missing, corrupt, or of another episode."""
    path = run.find_recording(result.key)
    scenario = next(candidate for candidate in run.scenarios if candidate.id == result.id)
    episode = load_episode(path)
    egos = tuple(ego.id for ego in scenario.egos)
    if episode.scenario != scenario.id or episode.ego_ids != egos:
        raise InputError(
            f"{path}: expected scenario {scenario.id} with CAVs {', '.join(egos)}, found"
            f" {truncate(episode.scenario, MAX_SHOWN)} with {truncate(', '.join(episode.ego_ids), MAX_SHOWN)}"
        )
    foreign = {ego.id for ego in result.egos} - {*egos}
    last = max((event.tick for ego in result.egos for event in ego.infractions), default=0)
    if foreign or last >= episode.ticks:
        raise InputError(
            f"{path}: expected the recording of {RESULTS_NAME}, found one of {episode.ticks} ticks with CAVs"
            f" {', '.join(egos)}, where the results have tick {last} and CAVs"
            f" {truncate(', '.join(ego.id for ego in result.egos), MAX_SHOWN)}"
        )
    return episode


def check_recordings(run: PreparedRun, episodes: Iterable[EpisodeKey], checksums: Mapping[EpisodeKey, str]) -> None:
    """Raise InputError for a recording of these episodes that is not the file which the journal notes.

    checksums: by scenario and seed; an episode without one is not checked.
    """
    for key in episodes:
        path, expected = run.find_recording(key), checksums.get(key)
        if expected is None:
            continue
        try:
            checksum = compute_file_checksum(path)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
        if checksum != expected:
            raise InputError(
                f"{path}: expected the recording that {JOURNAL_FILE} notes, {expected[:19]}..., found another file of"
                f" {path.stat().st_size} bytes, {checksum[:19]}...: it was changed or damaged; delete it, and `eval`"
                " drives the scenario again"
            )
