"""Enumerations that the database, the API and the pages share: states, verdicts, tracks, scopes."""

from enum import StrEnum, auto

MIN_HIDDEN_SCENARIOS = 5
"""Scenarios in a mean of a hidden phase at least: a mean of fewer would disclose single results."""


class ChallengeTrack(StrEnum):
    """Leaderboards of a phase. The channel enforces the track, whatever the agent declares."""

    SINGLE = "single-agent"
    SHARING = "perception-sharing"
    NEGOTIATION = "negotiation"
    JOINT = "joint"
    """One program drives all CAVs of a scenario, without limits of communication; ranked separately."""


class TokenScope(StrEnum):
    """Permissions of a token."""

    SUBMIT = auto()
    """All actions of a team."""
    ADMIN = auto()
    WORKER = auto()


class SubmissionState(StrEnum):
    """State of a submission."""

    QUEUED = auto()
    RUNNING = auto()
    DONE = auto()
    """Every scenario has its result; failures of the agent are results."""
    REJECTED = auto()
    """The archive or what the agent requires is refused."""
    CANCELLED = auto()
    FAILED_OURS = "failed-ours"
    """Our evaluation failed after every retry; does not count against a quota."""
    DISQUALIFIED = auto()
    OVER_BUDGET = "over-budget"
    """Its jobs used more worker time than a submission has; nothing is scored, and it counts against the quota."""


class JobKind(StrEnum):
    """What a job is for. All kinds share table, lease, retry and dispatcher."""

    SUBMISSION = auto()
    """One scenario and seed of a submission."""
    CROSS_PLAY = "cross-play"
    """One scenario in which a CAV of a submission drives among CAVs of another."""
    SPOT_CHECK = "spot-check"
    """A finished scenario of a submission, run again for comparison."""


class JobState(StrEnum):
    """State of one scenario and seed of a submission."""

    QUEUED = auto()
    RUNNING = auto()
    DONE = auto()
    FAILED = auto()
    """Our evaluation failed after every retry."""
    CANCELLED = auto()


class ScenarioVerdict(StrEnum):
    """Verdict on a scenario."""

    OK = auto()
    AGENT_FAILED = "agent-failed"
    """At least one CAV's agent failed, see `mdrive_sumo.core.state.FailureReason`. The scenario is scored."""
    FAILED_OURS = "failed-ours"


class DeliveryState(StrEnum):
    """State of a notification by webhook."""

    WAITING = auto()
    """It was not sent yet, or will be tried again."""
    DELIVERED = auto()
    FAILED = auto()
    """Every attempt failed."""
