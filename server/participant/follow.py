"""A submission under way, line by line, until it is finished."""

import time
from collections.abc import Callable, Mapping
from typing import Any

from mdrive_sumo.core.errors import InputError
from server.enums import State
from server.participant.client import Client, Unreachable

FINISHED = frozenset(State) - {State.QUEUED, State.RUNNING}
PAUSE_S = 2.0
"""Before asking again where the stream of events has ended."""
TRIES = 30
"""So often in a row nobody may answer: servers are restarted, and submissions go on."""
Say = Callable[[str], None]


def follow(client: Client, submission: str, say: Say, pause_s: float = PAUSE_S) -> State:
    """Says what happens, and the result; returns the last state. Raises InputError."""
    after, told, tries = "", "", 0
    while True:
        try:
            for event_id, kind, data in client.events(submission, after):
                after, tries = event_id or after, 0
                if kind == "scenario":
                    say(scenario_line(data))
                if kind == "state":
                    told = state_line(data)
                    say(told)
            shown = client.show(submission)  # a stream may end for any reason
            if shown.get("state") in FINISHED:
                if told != state_line(shown):
                    say(state_line(shown))
                return concluded(shown, say)
        except Unreachable:
            tries += 1
            if tries > TRIES:
                raise
        time.sleep(pause_s)


def state_line(data: Mapping[str, Any]) -> str:
    """A submission's state, and why."""
    why = data.get("why")
    return f"{data.get('state')}{f': {why}' if why else ''}"


def scenario_line(data: Mapping[str, Any]) -> str:
    """What became of a scenario."""
    reason = data.get("reason")
    numbers = "".join(f"  {name.upper()} {data[name]:6.2f}" for name in ("ds", "sr") if data.get(name) is not None)
    return f"{data.get('verdict')}{f' ({reason})' if reason else ''}: {data.get('scenario')}{numbers}"


def concluded(shown: Mapping[str, Any], say: Say) -> State:
    """Says the result, where there is one."""
    overall = (shown.get("summary") or {}).get("overall", {})
    numbers = ", ".join(
        f"{name.upper()} {overall[name]:.2f}" for name in ("ds", "sr", "rc") if overall.get(name) is not None
    )
    if numbers:
        say(f"overall: {numbers}")
    try:
        return State(shown["state"])
    except (KeyError, ValueError):
        raise InputError(f"server: expected a state among {', '.join(State)}, found {shown.get('state')!r}") from None
