"""Where a run keeps its files."""

from pathlib import Path

EPISODES_FOLDER = "episodes"
LOGS_FOLDER = "logs"
TRANSCRIPTS_FOLDER = "transcripts"
CAMERAS_FOLDER = "cameras"


def seed_folder(folder: Path, seed: int | None) -> Path:
    """Return the folder of a seed's files in a run of several seeds; the folder itself in a run of one (None)."""
    return folder if seed is None else folder / f"seed{seed}"


def recording_path(run_folder: Path, scenario: str, seed: int | None = None) -> Path:
    """Return the path at which a run keeps the recording of a scenario. seed: only of a run of several seeds."""
    return seed_folder(run_folder / EPISODES_FOLDER, seed) / f"{scenario}.npz"


def find_agent_log(run_folder: Path, scenario: str, ego: str, seed: int | None = None) -> Path | None:
    """Return the output of a CAV's agent, or of the joint agent; None if there is none (agents that are built in).

    seed: only of a run of several seeds.
    """
    folder = seed_folder(run_folder / LOGS_FOLDER, seed)
    paths = (folder / f"{scenario}.{ego}.log", folder / f"{scenario}.all.log")
    return next((path for path in paths if path.is_file()), None)
