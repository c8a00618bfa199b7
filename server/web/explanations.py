"""What states, verdicts and reasons mean, in a sentence each."""

from collections.abc import Mapping

from server.enums import Reason, State, Verdict

STATES: Mapping[State, str] = {
    State.QUEUED: "It waits for its turn.",
    State.RUNNING: "It is being driven.",
    State.DONE: "Every scenario has its result.",
    State.REJECTED: "The agent asks for what it may not have: nothing is scored, and it uses quota.",
    State.CANCELLED: "It was stopped by its team, or by those who run this server.",
    State.FAILED_OURS: "Our evaluation failed; it uses no quota.",
    State.DISQUALIFIED: "It was taken off the leaderboards.",
}
VERDICTS: Mapping[str, str] = {
    Verdict.OK: "The scenario was driven to its end.",
    Verdict.AGENT_FAILED: "The agent of at least one car failed; the scenario is scored as far as it came.",
    Verdict.FAILED_OURS: "Our fault: the scenario could not be driven.",
}
REASONS: Mapping[str, str] = {
    Reason.CRASHED: "Its program ended or raised an error; the log says how.",
    Reason.TIMEOUT: "It took longer to answer than it may.",
    Reason.INVALID: "It answered something that is no valid answer.",
}
OUTCOMES: Mapping[str, str] = {
    "arrived": "reached the end of its route",
    "blocked": "did not move for too long",
    "deviated": "left its route",
    "timed-out": "was not there in time",
    "agent-failed": "its agent failed",
}
COLOURS: Mapping[str, str] = {
    State.DONE: "good",
    State.REJECTED: "bad",
    State.FAILED_OURS: "warn",
    State.DISQUALIFIED: "bad",
    Verdict.OK: "good",
    Verdict.AGENT_FAILED: "bad",
}
"""Classes of tags; the word itself is always there, too."""
