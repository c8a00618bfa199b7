"""Where and why a candidate of the adversarial search is rejected."""

from enum import StrEnum


class RejectionStage(StrEnum):
    """Where a candidate was rejected, in order."""

    BUILD = "build"
    LENGTH = "length"
    """Many CAVs on long routes: too dear."""
    DANGER = "danger"
    """Blind driving does no harm."""
    FEASIBILITY = "feasibility"
    """`omniscient` does not solve it with every seed."""
    UNAIDED = "unaided"
    """Agents without messages do well already."""
    GAP = "gap"
    """The best rules that talk do well already."""
    FAILURE = "failure"
    """The worker process died or took too long."""


class CandidateRejected(Exception):
    """A candidate does not pass a stage."""

    def __init__(self, stage: RejectionStage, reason: str, score: float | None = None) -> None:
        """score: what an agent reached that must not reach so much."""
        super().__init__(stage, reason)
        self.stage, self.reason, self.score = stage, reason, score
