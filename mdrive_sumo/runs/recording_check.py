"""Compare recordings with the checksums that the journal notes."""

from collections.abc import Iterable, Mapping

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import EpisodeKey


def check_recordings(run: PreparedRun, episodes: Iterable[EpisodeKey], checksums: Mapping[EpisodeKey, str]) -> None:
    """Raise InputError for a recording of these episodes that is not the file which the journal notes.

    checksums: by scenario and seed; an episode without one, as in journals of older versions, is not checked.
    """
    for key in episodes:
        path, expected = run.find_recording(key), checksums.get(key)
        if expected is None:
            continue
        try:
            found = compute_file_checksum(path)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
        if found != expected:
            raise InputError(
                f"{path}: expected the recording that {JOURNAL_FILE} notes, {expected[:19]}..., found another file of"
                f" {path.stat().st_size} bytes, {found[:19]}...: it was changed or damaged; delete it, and `eval`"
                " drives the scenario again"
            )
