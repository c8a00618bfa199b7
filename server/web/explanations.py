"""What states, verdicts and reasons mean, in a sentence each."""

from collections.abc import Mapping

from server.enums import FailureReason, ScenarioVerdict, SubmissionState

STATES: Mapping[SubmissionState, str] = {
    SubmissionState.QUEUED: "It waits for its turn.",
    SubmissionState.RUNNING: "It is being driven.",
    SubmissionState.DONE: "Every scenario has its result.",
    SubmissionState.REJECTED: "The agent asks for what it may not have: nothing is scored, and it uses quota.",
    SubmissionState.CANCELLED: "It was stopped by its team, or by those who run this server.",
    SubmissionState.FAILED_OURS: "Our evaluation failed; it uses no quota.",
    SubmissionState.DISQUALIFIED: "It was taken off the leaderboards.",
}
VERDICTS: Mapping[str, str] = {
    ScenarioVerdict.OK: "The scenario was driven to its end.",
    ScenarioVerdict.AGENT_FAILED: "The agent of at least one car failed; the scenario is scored as far as it came.",
    ScenarioVerdict.FAILED_OURS: "Our fault: the scenario could not be driven.",
}
REASONS: Mapping[str, str] = {
    FailureReason.CRASHED: "Its program ended or raised an error; the log says how.",
    FailureReason.TIMEOUT: "It took longer to answer than it may.",
    FailureReason.INVALID: "It answered something that is no valid answer.",
}
OUTCOMES: Mapping[str, str] = {
    "arrived": "reached the end of its route",
    "blocked": "did not move for too long",
    "deviated": "left its route",
    "timed-out": "was not there in time",
    "agent-failed": "its agent failed",
}
COLOURS: Mapping[str, str] = {
    SubmissionState.DONE: "good",
    SubmissionState.REJECTED: "bad",
    SubmissionState.FAILED_OURS: "warn",
    SubmissionState.DISQUALIFIED: "bad",
    ScenarioVerdict.OK: "good",
    ScenarioVerdict.AGENT_FAILED: "bad",
}
"""Classes of tags; the word itself is always there, too."""
