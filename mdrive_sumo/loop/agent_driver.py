"""Driver: how the loop talks to an agent, wherever it lives. The one place where a participant's failure is caught."""

import time
from typing import Protocol

from mdrive_sumo.contract import Agent, Briefing, Observation, Reply, ReplyError, SensorSpec, check_reply
from mdrive_sumo.core.errors import MdriveError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.vehicle.control import CONTROLLERS

CONTROLLER_NAMES = frozenset(CONTROLLERS)


class AgentFailure(MdriveError):
    """A participant's code failed. It ends that CAV with `End.AGENT_FAILED`, and is scored."""

    def __init__(self, failure: FailureReason, text: str) -> None:
        super().__init__(text)
        self.failure, self.text = failure, text


class AgentDriver(Protocol):
    """One CAV's agent. `ask` and `answer` are apart so that agents in other processes think at the same time."""

    @property
    def label(self) -> str:
        """What the agent calls itself: one of `contract.LABELS`."""
        ...

    @property
    def think_time_s(self) -> float:
        """How long the agent took for its last answer, wall clock; only a measured agent clock asks."""
        ...

    def sensors(self) -> tuple[SensorSpec, ...]:
        """What the agent declared; raises AgentFailure, as all methods here."""
        ...

    def start(self, briefing: Briefing) -> None:
        """Briefs the agent."""
        ...

    def ask(self, seen: Observation) -> None:
        """Hands over an observation."""
        ...

    def answer(self) -> Reply:
        """The checked reply to the last observation."""
        ...

    def close(self) -> None:
        """Ends the agent; never raises."""
        ...


class LocalDriver:
    """A built-in agent in this process: trusted not to hang, but caught and checked like everybody else."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self._seen: Observation | None = None
        self.label = getattr(agent, "label", "single")
        self.think_time_s = 0.0

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See Driver."""
        return self._agent.sensors()

    def start(self, briefing: Briefing) -> None:
        """See Driver."""
        try:
            self._agent.start(briefing)
        except Exception as error:
            raise AgentFailure(FailureReason.CRASHED, describe_error(error)) from error

    def ask(self, seen: Observation) -> None:
        """See Driver."""
        self._seen = seen

    def answer(self) -> Reply:
        """See Driver."""
        assert self._seen is not None
        since = time.perf_counter()
        try:
            reply = self._agent.act(self._seen)
        except Exception as error:
            raise AgentFailure(FailureReason.CRASHED, describe_error(error)) from error
        self.think_time_s = time.perf_counter() - since
        return validate_reply(reply)

    def close(self) -> None:
        """See Driver."""


def validate_reply(reply: object) -> Reply:
    """The reply, if it keeps the contract; AgentFailure `invalid` if not."""
    try:
        return check_reply(reply, CONTROLLER_NAMES)
    except ReplyError as error:
        raise AgentFailure(FailureReason.INVALID, str(error)) from None


def describe_error(error: BaseException) -> str:
    """An exception as one short line."""
    return shorten(f"{type(error).__name__}: {error}")


def shorten(text: str, most: int = 200) -> str:
    """A text as one short printable line: it may be a participant's, and goes into logs, terminals and pages."""
    line = "".join(c if c.isprintable() else "?" for c in " ".join(text[: 4 * most].split()))
    return line if len(line) <= most else line[: most - 3] + "..."
