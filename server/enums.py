"""The words of the challenge: states and verdicts that the database, the API and the pages share."""

from enum import StrEnum, auto

MIN_HIDDEN_SCENARIOS = 5
"""Scenarios that a mean of a hidden phase is taken of: fewer, and it would be the result of single ones."""


class ChallengeTrack(StrEnum):
    """Leaderboards of a phase. Cooperation is what the messages of an agent's CAVs were, not what it calls itself."""

    SINGLE = "single-agent"
    SHARING = "perception-sharing"
    NEGOTIATION = "negotiation"
    JOINT = "joint"
    """One program drives all CAVs of a scenario: no limit of communication holds, so it is ranked apart."""


class TokenScope(StrEnum):
    """What a token allows."""

    SUBMIT = auto()
    """Everything a team does."""
    ADMIN = auto()
    WORKER = auto()


class SubmissionState(StrEnum):
    """Of a submission."""

    QUEUED = auto()
    RUNNING = auto()
    DONE = auto()
    """Every scenario has its result; failures of the agent are results."""
    REJECTED = auto()
    """The archive or what it asks for is refused; nothing was driven."""
    CANCELLED = auto()
    FAILED_OURS = "failed-ours"
    """Our fault, after every retry; it counts against no quota."""
    DISQUALIFIED = auto()


class JobState(StrEnum):
    """Of one scenario and seed of a submission."""

    QUEUED = auto()
    RUNNING = auto()
    DONE = auto()
    FAILED = auto()
    """Ours, after every retry."""
    CANCELLED = auto()


class ScenarioVerdict(StrEnum):
    """What became of a scenario."""

    OK = auto()
    AGENT_FAILED = "agent-failed"
    """At least one CAV's agent failed; `Reason` says how. The scenario is scored."""
    FAILED_OURS = "failed-ours"


class FailureReason(StrEnum):
    """Why an agent failed."""

    CRASHED = auto()
    TIMEOUT = auto()
    INVALID = auto()
