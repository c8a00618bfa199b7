"""Transcripts: every exchange with a language model as a line of JSON, so that a run can be repeated without it."""

from pathlib import Path

from mdrive_sumo.contract import EXCHANGE
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.episode import EpisodeRecord

TRANSCRIPT_FILE = "transcript.jsonl"


def transcript_path(folder: Path, scenario: str) -> Path:
    """Return the path of the transcript of one scenario."""
    return folder / f"{scenario}.jsonl"


def save_transcript(episode: EpisodeRecord, folder: Path) -> None:
    """Write the exchanges of an episode in their order to FOLDER/SCENARIO.jsonl, if there are any."""
    lines = [record.note.text for record in episode.notes if record.note.kind == EXCHANGE]
    path = transcript_path(folder, episode.scenario)
    if lines:
        make_folder(folder)
        write_text(path, "\n".join(lines) + "\n")
    else:
        path.unlink(missing_ok=True)


def concatenate_transcripts(folder: Path, scenarios: tuple[str, ...]) -> str:
    """Return the transcripts of the scenarios one after the other; "" if there are none."""
    paths = (transcript_path(folder, scenario) for scenario in scenarios)
    return "".join(read_text(path) for path in paths if path.is_file())
