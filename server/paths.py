"""Paths of the files of a submission: the evaluation writes them, the API returns them.

data/archives/<sha256>.zip                                  the archive
data/recordings/<submission>/<seed>/<scenario>.npz          the episode
data/recordings/<submission>/<seed>/<scenario>.html         its replay page, written at the first request
data/recordings/<submission>/<seed>/<scenario>.<cav>.log    the log of an agent (`all` for a joint agent)

Hidden phases have no recordings and no logs.
"""

from pathlib import Path

from server.settings import ServerSettings


def archive_path(settings: ServerSettings, sha256: str) -> Path:
    """Return the path of an archive."""
    return settings.archives / f"{sha256}.zip"


def recordings_folder(settings: ServerSettings, submission: str, seed: int) -> Path:
    """Return the folder of all scenarios with one seed."""
    return settings.recordings / submission / str(seed)


def recording_path(settings: ServerSettings, submission: str, scenario: str, seed: int) -> Path:
    """Return the path of a recorded episode."""
    return recordings_folder(settings, submission, seed) / recording_name(scenario)


def recording_name(scenario: str) -> str:
    """Return the file name of a recorded episode."""
    return f"{scenario}.npz"


def replay_path(settings: ServerSettings, submission: str, scenario: str, seed: int) -> Path:
    """Return the path of its replay page."""
    return recordings_folder(settings, submission, seed) / f"{scenario}.html"


def log_path(settings: ServerSettings, submission: str, scenario: str, seed: int, cav: str) -> Path:
    """Return the path of the log of one CAV's agent; `all` for a joint agent."""
    return recordings_folder(settings, submission, seed) / log_name(scenario, cav)


def log_name(scenario: str, cav: str) -> str:
    """Return the file name of the log of one CAV's agent."""
    return f"{scenario}.{cav}.log"
