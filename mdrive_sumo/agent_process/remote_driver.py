"""RemoteDriver: one CAV's agent in a process of its own, so that one that hangs in C code can be ended."""

import pickle
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mdrive_sumo.agent_process import reply_decoding
from mdrive_sumo.agent_process.agent_connection import AgentConnection, AgentLimits
from mdrive_sumo.agent_process.child_process import AgentBox, AgentProgram, BoxedAgentProcess, PlainAgentProcess
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.agent_process.wire_protocol import CREATE_TICK, START_TICK
from mdrive_sumo.contract import LABELS, Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure

__all__ = ["AgentLimits", "RemoteDriver", "SensorCheck", "open_agent_connection"]

SensorCheck = Callable[[tuple[SensorSpec, ...]], None]


class RemoteDriver:
    """A Driver whose agent runs in `host`. Every method raises AgentFailure; after one the process is gone."""

    def __init__(self, line: AgentConnection, config: Mapping[str, Any], check: SensorCheck | None = None) -> None:
        """Owns the line; the agent is being made when this returns. check: refuses sensors by an exception."""
        self._line, self._check = line, check
        self._declared: reply_decoding.AgentDeclaration | None = None
        self._failure: AgentFailure | None = None
        self.think_time_s = 0.0
        try:
            line.send("create", CREATE_TICK, dict(config))
        except AgentFailure as error:
            self._failure = error  # raised when somebody asks: who makes drivers is not prepared for it

    @property
    def label(self) -> str:
        """What the agent calls itself."""
        label = self._declaration().label
        if label not in LABELS:
            self._line.fail(FailureReason.INVALID, f"label: expected one of {', '.join(LABELS)}, found {label!r:.60}")
        return label

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See Driver; raises what the check raises, too."""
        sensors = self._declaration().sensors
        if self._check is not None:
            self._check(sensors)
        return sensors

    def start(self, briefing: Briefing) -> None:
        """See Driver."""
        self._line.send("start", START_TICK, briefing)
        self._line.receive(reply_decoding.read_none)

    def ask(self, seen: Observation) -> None:
        """See Driver."""
        self._line.send("act", seen.tick, seen)

    def answer(self) -> Reply:
        """See Driver."""
        reply = self._line.receive(reply_decoding.read_reply)
        self.think_time_s = self._line.think_times_s[-1]
        return reply

    def close(self) -> None:
        """See Driver."""
        self._line.close()

    def usage_record(self) -> Mapping[str, Any]:
        """Of a closed driver, see `Line.record`."""
        return self._line.usage_record()

    def _declaration(self) -> reply_decoding.AgentDeclaration:
        if self._failure is not None:
            raise self._failure
        if self._declared is None:
            self._declared = self._line.receive(reply_decoding.read_declaration)
        return self._declared


def open_agent_connection(program: AgentProgram, limits: AgentLimits, box: AgentBox | None = None) -> AgentConnection:
    """Start an agent's process, plain or boxed, and return the connection. Raises InputError, BoxError, OSError."""
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
    return AgentConnection(child, frames, limits)
