"""Why a proposal, or a candidate of the hard tier, became no scenario: the stage of the pipeline and the reason."""

from collections.abc import Generator
from contextlib import contextmanager
from enum import StrEnum

from mdrive_sumo.core.errors import InputError


class PipelineStage(StrEnum):
    """Stages of the pipeline in order."""

    RULES = "rules"
    CROP = "crop"
    WAYS = "ways"
    SPAWNS = "spawns"
    ACTORS = "actors"
    SOUNDNESS = "soundness"
    DUPLICATES = "duplicates"
    DIFFICULTY = "difficulty"
    FEASIBILITY = "feasibility"


class ProposalRejected(Exception):
    """A stage rejected the proposal; `args` are the stage and the reason."""

    def __init__(self, stage: PipelineStage, reason: str) -> None:
        super().__init__(stage, reason)
        self.stage, self.reason = stage, reason


@contextmanager
def reject_at(stage: PipelineStage, where: str = "") -> Generator[None]:
    """Turn an InputError into the rejection of the proposal at a stage; `where`: begin of the reason."""
    try:
        yield
    except InputError as error:
        raise ProposalRejected(stage, f"{where}{error}") from None
