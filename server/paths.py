"""Where the files of a submission lie: the evaluation writes them, the API hands them out.

data/archives/<sha256>.zip                                  what the team sent
data/recordings/<submission>/<seed>/<scenario>.npz          the episode
data/recordings/<submission>/<seed>/<scenario>.html         its replay page, made when first asked for
data/recordings/<submission>/<seed>/<scenario>.<cav>.log    what an agent wrote (`all` for a joint agent)

Of hidden phases there are no recordings and no logs.
"""

from pathlib import Path

from server.settings import ServerSettings

JOINT_CAV = "all"
"""Stands for the CAV in the log of a joint agent."""


def archive_path(settings: ServerSettings, sha256: str) -> Path:
    """What the team sent."""
    return settings.archives / f"{sha256}.zip"


def recordings_folder(settings: ServerSettings, submission: str, seed: int) -> Path:
    """Of all scenarios with one seed: `Job.log_folder`."""
    return settings.recordings / submission / str(seed)


def recording_path(settings: ServerSettings, submission: str, scenario: str, seed: int) -> Path:
    """The episode of one scenario and seed."""
    return recordings_folder(settings, submission, seed) / f"{scenario}.npz"


def replay_path(settings: ServerSettings, submission: str, scenario: str, seed: int) -> Path:
    """The page that replays it."""
    return recordings_folder(settings, submission, seed) / f"{scenario}.html"


def log_path(settings: ServerSettings, submission: str, scenario: str, seed: int, cav: str) -> Path:
    """What the agent of one CAV wrote; `ALL` for a joint agent."""
    return recordings_folder(settings, submission, seed) / f"{scenario}.{cav}.log"
