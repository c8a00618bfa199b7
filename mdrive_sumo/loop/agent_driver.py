"""The interface between the loop and an agent, in this process or another; failures of agents are caught here."""

import time
from typing import Protocol

from mdrive_sumo.contract import (
    Agent,
    Briefing,
    Observation,
    Reply,
    ReplyError,
    SensorSpec,
    check_reply,
    read_label,
    read_sensors,
)
from mdrive_sumo.core.clean_text import truncate
from mdrive_sumo.core.errors import MdriveError, WorldError
from mdrive_sumo.core.private_paths import hide_paths_in_text
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.vehicle.control import CONTROLLERS

CONTROLLER_NAMES = frozenset(CONTROLLERS)


class AgentFailure(MdriveError):
    """An agent failed. Its CAV brakes to a stop, ends with `End.AGENT_FAILED`, and is scored."""

    def __init__(self, failure: FailureReason, text: str) -> None:
        super().__init__(text)
        self.failure, self.text = failure, text


class AgentDriver(Protocol):
    """The agent of one CAV. The steps of a tick are separate, so that agents in other processes run in parallel.

    All agents are asked, then all requests are sent, then the answers are awaited: no agent learns from the time of its
    request how long another one thought in this tick.
    """

    @property
    def label(self) -> str:
        """What the agent says of itself: one of `contract.LABELS`."""
        ...

    @property
    def think_time_s(self) -> float:
        """Wall-clock time [s] of the last reply, for a measured agent clock."""
        ...

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the declared sensors. Raises AgentFailure, as all methods but `close` do."""
        ...

    def start(self, briefing: Briefing) -> None:
        """Brief the agent."""
        ...

    def ask(self, observation: Observation) -> None:
        """Prepare the request with an observation."""
        ...

    def send(self) -> None:
        """Send the prepared request; never waits for the agent."""
        ...

    def answer(self) -> Reply:
        """Return the validated reply to the last observation."""
        ...

    def close(self) -> None:
        """End the agent; never raises."""
        ...


class LocalDriver:
    """An agent in this process: it is trusted not to hang; its failures and replies are handled as all others."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self._observation: Observation | None = None
        self.label = read_label(agent)
        self.think_time_s = 0.0

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See Driver."""
        return read_sensors(self._agent)

    def start(self, briefing: Briefing) -> None:
        """See Driver."""
        try:
            self._agent.start(briefing)
        except WorldError:  # of what a briefing computes when it is read
            raise
        except Exception as error:
            raise AgentFailure(FailureReason.CRASHED, describe_error(error)) from error

    def ask(self, observation: Observation) -> None:
        """See Driver."""
        self._observation = observation

    def send(self) -> None:
        """See Driver."""

    def answer(self) -> Reply:
        """See Driver."""
        assert self._observation is not None
        since = time.perf_counter()
        try:
            reply = self._agent.act(self._observation)
        except WorldError:  # of the sensors, which compute what the agent reads
            raise
        except Exception as error:
            raise AgentFailure(FailureReason.CRASHED, describe_error(error)) from error
        self.think_time_s = time.perf_counter() - since
        return validate_reply(reply)

    def close(self) -> None:
        """See Driver."""


def validate_reply(reply: object) -> Reply:
    """Return the reply. Raises AgentFailure (invalid) if it violates the contract."""
    try:
        return check_reply(reply, CONTROLLER_NAMES)
    except ReplyError as error:
        raise AgentFailure(FailureReason.INVALID, str(error)) from None


def describe_error(error: BaseException) -> str:
    """Return an exception as one short line, without folders of this machine: results and recordings have it."""
    return shorten(hide_paths_in_text(f"{type(error).__name__}: {error}"))


def shorten(text: str, max_length: int = 200) -> str:
    """Return a text as one short printable line: a participant's text goes to logs, terminals and pages."""
    line = "".join(c if c.isprintable() else "?" for c in " ".join(text[: 4 * max_length].split()))
    return truncate(line, max_length)
