"""Explanations of states, verdicts and reasons, one sentence each."""

from collections.abc import Mapping

from mdrive_sumo.core.state import FailureReason
from server.enums import ScenarioVerdict, SubmissionState

STATES: Mapping[SubmissionState, str] = {
    SubmissionState.QUEUED: "Waiting in the queue.",
    SubmissionState.RUNNING: "Running.",
    SubmissionState.DONE: "Every scenario has a result.",
    SubmissionState.REJECTED: (
        "The agent requires what is not allowed; nothing is scored."
        " It uses quota only after a first result, or in a hidden phase."
    ),
    SubmissionState.CANCELLED: "Cancelled by its team or by an admin.",
    SubmissionState.FAILED_OURS: "Our evaluation failed; it does not count against the quota.",
    SubmissionState.DISQUALIFIED: "Removed from the leaderboards.",
    SubmissionState.OVER_BUDGET: "It needs more worker time than a submission has; counts against the quota.",
}
VERDICTS: Mapping[str, str] = {
    ScenarioVerdict.OK: "No agent failed; outcome and scores say how well the cars drove.",
    ScenarioVerdict.AGENT_FAILED: "The agent of at least one car failed: it brakes to a stop, at a cost of x 0.60.",
    ScenarioVerdict.FAILED_OURS: "Our evaluation failed: the scenario has no result.",
}
REASONS: Mapping[str, str] = {
    FailureReason.CRASHED: "Its program ended or raised an error; see the log.",
    FailureReason.TIMEOUT: "It exceeded the time limit for a reply.",
    FailureReason.INVALID: "It sent an invalid reply.",
    FailureReason.LEFT: "The person who drove has left.",
}
OUTCOMES: Mapping[str, str] = {
    "arrived": "reached the end of its route",
    "blocked": "did not move for too long",
    "deviated": "left its route",
    "timed-out": "ran out of time",
    "agent-failed": "its agent failed",
}
COLOURS: Mapping[str, str] = {
    SubmissionState.DONE: "good",
    SubmissionState.REJECTED: "bad",
    SubmissionState.FAILED_OURS: "warn",
    SubmissionState.DISQUALIFIED: "bad",
    SubmissionState.OVER_BUDGET: "bad",
    ScenarioVerdict.AGENT_FAILED: "bad",
}
"""CSS classes of tags; the text always accompanies the colour."""
