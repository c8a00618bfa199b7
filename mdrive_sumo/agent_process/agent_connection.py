"""AgentConnection: sends requests to an agent's process, reads its answers, and enforces deadlines and sizes.

Requests and answers alternate; each answer names the tick of its request. `reply_decoding` reads the answers. Deadlines
cover whole messages in both directions: an agent that does not read, or that sends a byte a second, times out.

The agents of one episode are asked together and share a `ConnectionGroup`: a request is sent as far as its socket takes
it, and while one answer is awaited those of the others are timed and taken over, so no agent waits or pays for another.
"""

import bisect
import select
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, NoReturn, TypeVar

from mdrive_sumo.agent_process import wire_protocol
from mdrive_sumo.agent_process.child_process import AgentProcess
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.agent_process.reply_decoding import AgentCrashError, InvalidReplyError, decode_answer
from mdrive_sumo.core.bimodality import describe_modes
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure

T = TypeVar("T")
HISTOGRAM_MS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
"""Upper ends of the histogram of think times [ms]; one more class counts longer ones."""
SENDING_S = 0.01
"""Pause between attempts to send to an agent that does not read [s]."""
AT_ONCE = 2**18
"""Read from the socket at once [bytes]: more than its buffer, so that a timely answer is read in one piece."""


@dataclass(frozen=True, slots=True)
class AgentLimits:
    """Limits of an agent: wall-clock seconds, and bytes of its answers."""

    start_s: float = 60.0
    """For import and creation, and again for the briefing."""
    tick_s: float = 5.0
    """For one answer."""
    episode_s: float = 600.0
    """For all answers of an episode together."""
    reply_bytes: int = 65536
    """Longest answer: control or plan, messages and notes together."""
    pace_s: float = 0.0
    """Time from a request to the next one of a run with a pace: `usage_record` counts the answers that took longer."""
    episode_bytes: int = 2**24
    """All answers of an episode together: their messages and notes are kept in memory and recorded."""
    option: str = ""
    """The option by which the user changes the times, which failures name; "": they are fixed."""

    def describe_time(self, name: str) -> str:
        """Return a time limit as failures name it. name: start, tick or episode."""
        remedy = f"; {self.option} {name}=SECONDS changes it" if self.option else ""
        return f"the time limit {name} ({getattr(self, f'{name}_s'):g} s){remedy}"


class _Deadline(NamedTuple):
    """When an agent must be done, on the clock `time.monotonic`, and the limit that it follows from."""

    at_s: float
    limit: str


class AgentConnection:
    """The connection to one process. Every method but `close` raises AgentFailure; after that the process is gone."""

    def __init__(
        self, child: AgentProcess, frames: FrameFolder, limits: AgentLimits, group: "ConnectionGroup | None" = None
    ) -> None:
        """Take ownership of the process and the frame folder. group: of the agents that are asked together."""
        self._child, self._frames, self.limits = child, frames, limits
        self._call, self._tick, self._requested_at, self._used_s, self._received_bytes = "", 0, 0.0, 0.0, 0
        self._open = True
        self._prepared: bytes | None = None
        self._unsent = memoryview(b"")
        self._received = b""
        self._answered_at: float | None = None
        """When the answer was complete, or could not become so; None while it is awaited."""
        self._group = group if group is not None else ConnectionGroup()
        self._group.add(self)
        self.failure = ""
        """Why the connection ended, if the agent failed."""
        self.think_times_s: list[float] = []
        """Think time of each answer of the episode."""
        child.socket.setblocking(False)

    def send(self, call: str, tick: int, value: object) -> None:
        """Prepare a request and send it."""
        self.prepare(call, tick, value)
        self.send_prepared()

    def prepare(self, call: str, tick: int, value: object) -> None:
        """Encode a request. An answer that has arrived before it ends the agent."""
        self._call, self._tick = call, tick
        if self._receive_available(1, socket.MSG_PEEK):
            self._fail(FailureReason.INVALID, "expected no answer before the request, found one")
        self._frames.begin()
        frame = {"call": call, "tick": tick, "value": value}
        self._prepared = wire_protocol.encode_frame(frame, self._frames.store)

    def send_prepared(self) -> None:
        """Send the request, if there is one, as far as the agent's socket takes it; `receive` sends what is left."""
        if self._prepared is not None:
            self._unsent, self._prepared = memoryview(self._prepared), None
            self._received, self._answered_at = b"", None
            self._requested_at = time.monotonic()
            self._send_more()

    def receive(self, read: Callable[[Any], T]) -> T:
        """Return the answer to the last request. read: a function of `reply_decoding` that checks plain values."""
        self.send_prepared()
        if self._tick < 0:
            return self._read_answer(_Deadline(time.monotonic() + self.limits.start_s, "start"), read)
        self._group.wait()
        answer = self._read_answer(self._find_deadline(), read)
        answered_at = self._answered_at if self._answered_at is not None else time.monotonic()
        self.think_times_s.append(answered_at - self._requested_at)
        self._used_s += self.think_times_s[-1]
        return answer

    @property
    def process(self) -> AgentProcess:
        """The process, for `ConnectionGroup`."""
        return self._child

    @property
    def has_unsent(self) -> bool:
        """Whether a part of the request is not sent yet."""
        return bool(self._unsent)

    def is_awaited(self) -> bool:
        """Return whether the answer to the observation of a tick can still arrive in time."""
        is_asked = self._open and self._tick >= 0 and self._requested_at > 0 and self._prepared is None
        return is_asked and self._answered_at is None and not _has_passed(self._find_deadline())

    def take_available(self) -> None:
        """Send and receive what is possible without waiting; failures show in `receive`."""
        try:
            self._send_more()
            room = wire_protocol.LENGTH.size + self.limits.reply_bytes + 1 - len(self._received)
            data = self._child.socket.recv(min(room, AT_ONCE))
        except BlockingIOError:
            return
        except OSError:
            data = b""
        self._received += data
        if not data or self._find_missing(self._received) <= 0:
            self._answered_at = time.monotonic()

    def find_left_s(self) -> float:
        """Return the time that is left for the answer, at least 0 [s]."""
        return max(0.0, self._find_deadline().at_s - time.monotonic())

    def _find_deadline(self) -> _Deadline:
        limit_s, limit = min((self.limits.tick_s, "tick"), (self.limits.episode_s - self._used_s, "episode"))
        return _Deadline(self._requested_at + limit_s, limit)

    def _find_missing(self, data: bytes) -> int:
        """Return how many bytes of a frame are missing at least; 0 or less where it is complete or invalid."""
        if len(data) < wire_protocol.LENGTH.size:
            return wire_protocol.LENGTH.size - len(data)
        size = wire_protocol.LENGTH.unpack_from(data)[0]
        return wire_protocol.LENGTH.size + size - len(data) if 0 < size <= self.limits.reply_bytes else 0

    def fail(self, failure: FailureReason, text: str) -> NoReturn:
        """End the process; raises AgentFailure."""
        self.failure = text
        self.close()
        raise AgentFailure(failure, text) from None

    def close(self) -> None:
        """End the process. Raises BoxError only."""
        if self._open:
            self._open = False
            try:
                self._child.close()
            finally:
                self._frames.close()

    def _read_answer(self, deadline: _Deadline, read: Callable[[Any], T]) -> T:
        data = self._read(deadline)
        self._received_bytes += len(data)
        if self._received_bytes > (most := self.limits.episode_bytes):
            self._fail(FailureReason.INVALID, f"expected answers of at most {most} bytes in an episode, found more")
        try:
            return read(decode_answer(data, self._tick))
        except InvalidReplyError as error:
            self._fail(FailureReason.INVALID, str(error))
        except AgentCrashError as error:
            self.fail(FailureReason.CRASHED, str(error))
        except AgentFailure as error:
            self.fail(error.failure, error.text)

    def _read(self, deadline: _Deadline) -> bytes:
        """Read one frame. Its length must be below the limit, and no byte may follow it."""
        data, self._received, most = self._received, b"", self.limits.reply_bytes
        while self._find_missing(data) > 0:
            self._wait(deadline, is_begun=bool(data))
            received = self._receive_available(min(wire_protocol.LENGTH.size + most + 1 - len(data), AT_ONCE))
            if not received and _has_passed(deadline):  # readable without data, again and again
                self._fail_late(deadline)
            data += received
        size = wire_protocol.LENGTH.unpack_from(data)[0]
        if not 0 < size <= most:
            self._fail(FailureReason.INVALID, f"expected an answer of at most {most} bytes, found {size}")
        if len(data) > wire_protocol.LENGTH.size + size:
            self._fail(FailureReason.INVALID, "expected one answer, found more")
        if self._unsent:
            self._fail(FailureReason.INVALID, "expected no answer before the whole request, found one")
        return data[wire_protocol.LENGTH.size :]

    def _wait(self, deadline: _Deadline, is_begun: bool) -> None:
        """Wait for a part of the answer, and meanwhile send what is left of the request."""
        while self._unsent:
            if self._child.wait_readable(SENDING_S):  # it takes over the output, without which the agent may not read
                return
            self._send_more()
            if _has_passed(deadline):
                self._fail_late(deadline)
        left_s = deadline.at_s - time.monotonic()
        if not self._child.wait_readable(left_s) or (is_begun and _has_passed(deadline)):
            self._fail_late(deadline)

    def _send_more(self) -> None:
        try:
            while self._unsent:
                self._unsent = self._unsent[self._child.socket.send(self._unsent) :]
        except BlockingIOError:
            return
        except (BrokenPipeError, ConnectionResetError):
            self._unsent = memoryview(b"")  # `receive` finds the end of the process

    def _fail_late(self, deadline: _Deadline) -> NoReturn:
        what = "the agent does not read" if self._unsent else "no answer"
        self._fail(FailureReason.TIMEOUT, f"{what} within {self.limits.describe_time(deadline.limit)}")

    def _receive_available(self, size: int, flags: int = 0) -> bytes:
        """Return the available bytes, b"" if there are none yet. `recv` drops passed file descriptors."""
        try:
            data = self._child.socket.recv(size, flags)
        except BlockingIOError:
            return b""
        except ConnectionResetError:
            data = b""
        return data or self._fail_process_ended()

    def _fail_process_ended(self) -> NoReturn:
        how = self._child.describe_exit() if self._open else "it was ended"
        self._fail(FailureReason.CRASHED, f"the agent's process ended ({how})")

    def _fail(self, failure: FailureReason, text: str) -> NoReturn:
        self.fail(failure, f"{self._call}: {text}")

    def usage_record(self) -> dict[str, Any]:
        """Return how the process of a closed connection ended, its resources, and its think times [ms]."""
        thought_ms = sorted(round(1000 * seconds, 3) for seconds in self.think_times_s)
        count = len(thought_ms)
        return {
            "failure": self.failure,
            "answers": count,
            "thought_ms": {
                "p50": thought_ms[count // 2] if count else None,
                "p99": thought_ms[min(count - 1, count * 99 // 100)] if count else None,
                "max": thought_ms[-1] if count else None,
                "sum": round(sum(thought_ms), 3),
                "counts": [after - before for before, after in pairwise((0, *_count_up_to(thought_ms), count))],
                "late": sum(seconds > self.limits.pace_s for seconds in self.think_times_s)
                if self.limits.pace_s
                else None,
                "modes": describe_modes(self.think_times_s),
            },
            **self._child.usage_record(),
        }


def _has_passed(deadline: _Deadline) -> bool:
    return time.monotonic() > deadline.at_s


def _count_up_to(thought_ms: list[float]) -> list[int]:
    """Return how many of the sorted times are within each upper end of the histogram."""
    return [bisect.bisect_right(thought_ms, end) for end in HISTOGRAM_MS]


class ConnectionGroup:
    """The connections to the agents of one episode, which are asked in the same moment."""

    def __init__(self) -> None:
        self._members: list[AgentConnection] = []

    def add(self, member: AgentConnection) -> None:
        """Add a connection."""
        self._members.append(member)

    def wait(self) -> None:
        """Wait until every answer that is awaited is complete, or its time is over."""
        while len(self._members) > 1 and (awaited := [each for each in self._members if each.is_awaited()]):
            self._wait_for_any(awaited)

    @staticmethod
    def _wait_for_any(awaited: Sequence[AgentConnection]) -> None:
        poller = select.poll()
        member_by_fd: dict[int, AgentConnection] = {}
        for member in awaited:
            fd, log_fd = member.process.socket.fileno(), member.process.log_fd
            poller.register(fd, select.POLLIN | (select.POLLOUT if member.has_unsent else 0))
            member_by_fd[fd] = member
            if log_fd >= 0:
                poller.register(log_fd, select.POLLIN)
                member_by_fd[log_fd] = member
        for fd, _ in poller.poll(1000 * min(member.find_left_s() for member in awaited)):
            member = member_by_fd[fd]
            if fd == member.process.log_fd:
                member.process.wait_readable(0.0)  # takes over the output
            else:
                member.take_available()
