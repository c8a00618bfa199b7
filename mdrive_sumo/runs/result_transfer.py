"""Transfer the files of a job from a machine that shares no disk: they come back with the result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult

RECORDING, CAMERAS, LOGS, TRANSCRIPTS = "recording.npz", "cameras.zip", "logs", "transcripts"


@dataclass(frozen=True, slots=True)
class TransferableResult:
    """A result, and the content of the files of its job by relative path."""

    result: ScenarioResult
    files: Mapping[str, bytes]


def run_with_output_files(function: Callable[[EpisodeJob], ScenarioResult], job: EpisodeJob) -> TransferableResult:
    """Run `function` (`run_job`) with its files in a temporary folder and return them with the result."""
    with TemporaryDirectory(prefix="mdrive-job-") as name:
        folder = Path(name)
        (folder / LOGS).mkdir()
        local = replace(
            job,
            recording=folder / RECORDING if job.recording else None,
            logs=folder / LOGS if job.logs else None,
            transcripts=folder / TRANSCRIPTS if job.transcripts else None,
            cameras=folder / CAMERAS if job.cameras else None,
        )
        result = function(local)
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        return TransferableResult(result, {str(path.relative_to(folder)): path.read_bytes() for path in paths})


def store_output_files(job: EpisodeJob, output: TransferableResult) -> ScenarioResult:
    """Write the files to the places that the job names and return the result. Raises OSError."""
    folders = {LOGS: job.logs, TRANSCRIPTS: job.transcripts}
    for name, data in output.files.items():
        first, _, rest = name.partition("/")
        folder = folders[first] if rest else None
        path = folder / rest if folder else {RECORDING: job.recording, CAMERAS: job.cameras}[name]
        assert path is not None, f"{name}: a file of a kind that the job does not ask for"
        make_parents(path)
        write_bytes(path, data)
    return output.result
