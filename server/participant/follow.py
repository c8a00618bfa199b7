"""Follows a submission until it is finished."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from mdrive_sumo.core.errors import InputError
from server.enums import SubmissionState
from server.participant.client import MAX_WAIT_S, ChallengeClient, ServerUnreachable

FINISHED = frozenset(SubmissionState) - {SubmissionState.QUEUED, SubmissionState.RUNNING}
PAUSE_S = 2.0
"""Pause before reconnecting to the event stream [s]."""
TRIES = 30
"""Consecutive failed attempts before giving up: a server may be restarting."""
SCORES = {"ds": "DS", "sr": "SR", "efficient_sr": "efficient SR", "time_ratio": "time ratio", "rc": "RC"}
"""Figures in the order of printing, those that the server tells."""
PrintLine = Callable[[str], None]


def follow(
    client: ChallengeClient, submission: str, print_line: PrintLine, pause_s: float = PAUSE_S
) -> SubmissionState:
    """Print events and the result; return the final state. Raises InputError."""
    after, printed, tries = "", "", 0
    while True:
        wait_s = pause_s
        try:
            for event_id, kind, data in client.events(submission, after):
                after, tries = event_id or after, 0
                if kind == "scenario":
                    print_line(format_scenario(data))
                if kind == "state":
                    printed = format_state(data)
                    print_line(printed)
            shown = client.show(submission)  # a stream may end for any reason
            if shown.get("state") in FINISHED:
                if printed != format_state(shown):
                    print_line(format_state(shown))
                return print_summary(shown, print_line)
        except ServerUnreachable as error:
            tries += 1
            if tries > TRIES:
                raise
            wait_s = max(pause_s, min(error.after_s or 0, MAX_WAIT_S))  # too many streams: it says how long
        time.sleep(wait_s)


def format_state(data: Mapping[str, Any]) -> str:
    """Format a submission's state with its reason."""
    why = data.get("why")
    return f"{data.get('state')}{f': {why}' if why else ''}"


def format_scenario(data: Mapping[str, Any]) -> str:
    """Format the result of a scenario."""
    reason = data.get("reason")
    numbers = "".join(f"  {text} {data[name]:6.2f}" for name, text in SCORES.items() if data.get(name) is not None)
    return f"{data.get('verdict')}{f' ({reason})' if reason else ''}: {data.get('scenario')}{numbers}"


def print_summary(shown: Mapping[str, Any], print_line: PrintLine) -> SubmissionState:
    """Print the overall result, if any, and return the state. Raises InputError."""
    overall = (shown.get("summary") or {}).get("overall", {})
    numbers = ", ".join(f"{text} {overall[name]:.2f}" for name, text in SCORES.items() if overall.get(name) is not None)
    if numbers:
        print_line(f"overall: {numbers}")
    try:
        return SubmissionState(shown["state"])
    except (KeyError, ValueError):
        raise InputError(
            f"server: expected a state among {', '.join(SubmissionState)}, found {shown.get('state')!r}"
        ) from None
