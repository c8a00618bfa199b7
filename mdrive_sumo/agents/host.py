"""The child process in which one third-party agent lives: `python -m mdrive_sumo.agents.host LOCATOR`.

It reads framed requests from its standard input and writes framed answers to what was its standard output; whatever
the agent prints goes to standard error. Frames are a 4-byte little-endian length and the bytes of `wire`.
"""

import ctypes
import os
import signal
import struct
import sys
from collections.abc import Callable, Mapping
from io import TextIOWrapper
from typing import Any, BinaryIO, cast

from mdrive_sumo.agents import wire
from mdrive_sumo.agents.lookup import agent_class
from mdrive_sumo.contract import Agent

PR_SET_PDEATHSIG = 1
LENGTH = struct.Struct("<I")


def framed(message: object) -> bytes:
    """A message as it travels."""
    data = wire.packed(message)
    return LENGTH.pack(len(data)) + data


def read_frame(stream: BinaryIO) -> Any:
    """The next message; raises EOFError at the end of the stream."""
    head = stream.read(LENGTH.size)
    if len(head) < LENGTH.size:
        raise EOFError
    return wire.unpacked(stream.read(LENGTH.unpack(head)[0]))


def main() -> None:
    """Serves one agent until the stream ends. Any exception of the agent is an answer, not a traceback."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # never outlive a killed worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    cast(TextIOWrapper, sys.stdout).reconfigure(line_buffering=True)  # what the agent prints survives its end
    requests = sys.stdin.buffer
    handle = _handler(sys.argv[1])
    while True:
        try:
            request = read_frame(requests)
        except EOFError:
            return
        answers.write(framed(_answered(handle, request)))
        answers.flush()


def _answered(handle: Callable[[str, Any], Any], request: Mapping[str, Any]) -> dict[str, Any]:
    try:
        answer = handle(request["call"], request["value"])
    except BaseException as error:  # noqa: BLE001 (the border to a participant's code; SystemExit included)
        import traceback

        traceback.print_exc()
        return {"crashed": f"{type(error).__name__}: {error}"}
    try:
        wire.packed(answer)
    except TypeError as error:
        return {"invalid": str(error)}
    return {"value": answer}


def _handler(locator: str) -> Callable[[str, Any], Any]:
    agent: list[Agent] = []

    def handle(call: str, value: Any) -> Any:
        if call == "create":
            agent.append(agent_class(locator)(value))
            return {"label": str(getattr(agent[0], "label", "single")), "sensors": tuple(agent[0].sensors())}
        return {"start": agent[0].start, "act": agent[0].act}[call](value)

    return handle


if __name__ == "__main__":
    main()
