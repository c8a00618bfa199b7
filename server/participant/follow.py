"""A submission under way, line by line, until it is finished."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from mdrive_sumo.core.errors import InputError
from server.enums import SubmissionState
from server.participant.client import ChallengeClient, ServerUnreachable

FINISHED = frozenset(SubmissionState) - {SubmissionState.QUEUED, SubmissionState.RUNNING}
PAUSE_S = 2.0
"""Before asking again where the stream of events has ended."""
TRIES = 30
"""So often in a row nobody may answer: servers are restarted, and submissions go on."""
PrintLine = Callable[[str], None]


def follow(client: ChallengeClient, submission: str, say: PrintLine, pause_s: float = PAUSE_S) -> SubmissionState:
    """Says what happens, and the result; returns the last state. Raises InputError."""
    after, told, tries = "", "", 0
    while True:
        try:
            for event_id, kind, data in client.events(submission, after):
                after, tries = event_id or after, 0
                if kind == "scenario":
                    say(format_scenario(data))
                if kind == "state":
                    told = format_state(data)
                    say(told)
            shown = client.show(submission)  # a stream may end for any reason
            if shown.get("state") in FINISHED:
                if told != format_state(shown):
                    say(format_state(shown))
                return print_summary(shown, say)
        except ServerUnreachable:
            tries += 1
            if tries > TRIES:
                raise
        time.sleep(pause_s)


def format_state(data: Mapping[str, Any]) -> str:
    """A submission's state, and why."""
    why = data.get("why")
    return f"{data.get('state')}{f': {why}' if why else ''}"


def format_scenario(data: Mapping[str, Any]) -> str:
    """What became of a scenario."""
    reason = data.get("reason")
    numbers = "".join(f"  {name.upper()} {data[name]:6.2f}" for name in ("ds", "sr") if data.get(name) is not None)
    return f"{data.get('verdict')}{f' ({reason})' if reason else ''}: {data.get('scenario')}{numbers}"


def print_summary(shown: Mapping[str, Any], say: PrintLine) -> SubmissionState:
    """Says the result, where there is one."""
    overall = (shown.get("summary") or {}).get("overall", {})
    numbers = ", ".join(
        f"{name.upper()} {overall[name]:.2f}" for name in ("ds", "sr", "rc") if overall.get(name) is not None
    )
    if numbers:
        say(f"overall: {numbers}")
    try:
        return SubmissionState(shown["state"])
    except (KeyError, ValueError):
        raise InputError(
            f"server: expected a state among {', '.join(SubmissionState)}, found {shown.get('state')!r}"
        ) from None
