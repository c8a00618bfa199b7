"""Compare recordings with the checksums that the journal notes."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.prepared_run import recording_path


def check_recordings(folder: Path, scenarios: Iterable[str], checksums: Mapping[str, str]) -> None:
    """Raise InputError for a recording of these scenarios that is not the file which the journal notes.

    checksums: by scenario id; a scenario without one, as in journals of older versions, is not checked.
    """
    for name in scenarios:
        path, expected = recording_path(folder, name), checksums.get(name)
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
