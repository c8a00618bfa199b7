"""RemoteDriver: one CAV's agent in a process of its own, which can be ended even if it hangs in C code."""

import pickle
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mdrive_sumo.agent_process import reply_decoding
from mdrive_sumo.agent_process.agent_connection import AgentConnection, AgentLimits, ConnectionGroup
from mdrive_sumo.agent_process.child_process import AgentBox, AgentProgram, BoxedAgentProcess, PlainAgentProcess
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.agent_process.wire_protocol import CREATE_TICK, START_TICK
from mdrive_sumo.contract import LABELS, Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure

__all__ = ["AgentLimits", "RemoteDriver", "SensorCheck", "open_agent_connection"]

SensorCheck = Callable[[tuple[SensorSpec, ...]], None]


class RemoteDriver:
    """An AgentDriver whose agent runs in `host`. Every method raises AgentFailure; after that the process is gone."""

    def __init__(self, line: AgentConnection, config: Mapping[str, Any], check: SensorCheck | None = None) -> None:
        """Take ownership of the connection and begin to create the agent. check: raises for refused sensors."""
        self._line, self._check = line, check
        self._declared: reply_decoding.AgentDeclaration | None = None
        self._failure: AgentFailure | None = None
        self.think_time_s = 0.0
        try:
            line.send("create", CREATE_TICK, dict(config))
        except AgentFailure as error:
            self._failure = error  # raised by the next call: callers of the constructor expect no failure of an agent

    @property
    def label(self) -> str:
        """The label that the agent declares."""
        label = self._declaration().label
        if label not in LABELS:
            self._line.fail(FailureReason.INVALID, f"label: expected one of {', '.join(LABELS)}, found {label!r:.60}")
        return label

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See AgentDriver; raises what the check raises, too."""
        sensors = self._declaration().sensors
        if self._check is not None:
            self._check(sensors)
        return sensors

    def start(self, briefing: Briefing) -> None:
        """See AgentDriver."""
        self._line.send("start", START_TICK, briefing)
        self._line.receive(reply_decoding.read_none)

    def ask(self, observation: Observation) -> None:
        """See AgentDriver."""
        self._line.prepare("act", observation.tick, observation)

    def send(self) -> None:
        """See AgentDriver."""
        self._line.send_prepared()

    def answer(self) -> Reply:
        """See AgentDriver."""
        reply = self._line.receive(reply_decoding.read_reply)
        self.think_time_s = self._line.think_times_s[-1]
        return reply

    def close(self) -> None:
        """See AgentDriver."""
        self._line.close()

    def usage_record(self) -> Mapping[str, Any]:
        """See `AgentConnection.usage_record`."""
        return self._line.usage_record()

    def _declaration(self) -> reply_decoding.AgentDeclaration:
        if self._failure is not None:
            raise self._failure
        if self._declared is None:
            self._declared = self._line.receive(reply_decoding.read_declaration)
        return self._declared


def open_agent_connection(
    program: AgentProgram, limits: AgentLimits, box: AgentBox | None = None, group: ConnectionGroup | None = None
) -> AgentConnection:
    """Start an agent's process, plain or boxed, and return the connection. Raises InputError, BoxError, OSError.

    group: of the agents of the same episode.
    """
    frames = FrameFolder()
    try:
        if program.pickled:
            file = frames.path / "agent.pickle"
            file.write_bytes(pickle.dumps((sys.path, program.pickled)))
            program = replace(program, locator=str(file))
        child = PlainAgentProcess(program, frames.path) if box is None else BoxedAgentProcess(program, frames.path, box)
    except BaseException:
        frames.close()
        raise
    return AgentConnection(child, frames, limits, group)
