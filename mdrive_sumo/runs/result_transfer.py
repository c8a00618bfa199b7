"""Jobs on machines that share no disk: what a job writes comes back with its result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from mdrive_sumo.runs.job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult

RECORDING, LOGS, TRANSCRIPTS = "recording.npz", "logs", "transcripts"


@dataclass(frozen=True, slots=True)
class TransferableResult:
    """A result, and the files of its job by their path in a folder of its own."""

    result: ScenarioResult
    files: Mapping[str, bytes]


def run_with_output_files(function: Callable[[EpisodeJob], ScenarioResult], job: EpisodeJob) -> TransferableResult:
    """Runs `function` (`run_job`) where its files are to be carried away."""
    with TemporaryDirectory(prefix="mdrive-job-") as name:
        folder = Path(name)
        (folder / LOGS).mkdir()
        inside = replace(
            job,
            recording=str(folder / RECORDING) if job.recording else "",
            log_folder=str(folder / LOGS) if job.log_folder else "",
            transcripts=str(folder / TRANSCRIPTS) if job.transcripts else "",
        )
        result = function(inside)
        written = sorted(path for path in folder.rglob("*") if path.is_file())
        return TransferableResult(result, {str(path.relative_to(folder)): path.read_bytes() for path in written})


def store_output_files(job: EpisodeJob, carried: TransferableResult) -> ScenarioResult:
    """Writes the files to where the job wanted them; raises OSError."""
    homes = {LOGS: job.log_folder, TRANSCRIPTS: job.transcripts}
    for name, data in carried.files.items():
        first, _, rest = name.partition("/")
        path = Path(homes[first]) / rest if rest else Path(job.recording)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        part.write_bytes(data)
        part.replace(path)
    return carried.result
