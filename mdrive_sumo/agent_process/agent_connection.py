"""AgentConnection: sends requests to an agent's process, reads its answers, and enforces deadlines and sizes.

Requests and answers alternate; each answer names the tick of its request. `reply_decoding` reads the answers. Deadlines
cover whole messages in both directions: an agent that does not read, or that sends a byte a second, times out.
"""

import bisect
import select
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, NoReturn, TypeVar

from mdrive_sumo.agent_process import wire_protocol
from mdrive_sumo.agent_process.child_process import AgentProcess
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.agent_process.reply_decoding import AgentCrashError, InvalidReplyError, decode_answer
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure

T = TypeVar("T")
HISTOGRAM_MS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
"""Upper ends of the histogram of think times [ms]; one more class counts longer ones."""
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

    def __init__(self, child: AgentProcess, frames: FrameFolder, limits: AgentLimits) -> None:
        """Take ownership of the process and the frame folder."""
        self._child, self._frames, self.limits = child, frames, limits
        self._call, self._tick, self._requested_at, self._used_s, self._received_bytes = "", 0, 0.0, 0.0, 0
        self._open = True
        self.failure = ""
        """Why the connection ended, if the agent failed."""
        self.think_times_s: list[float] = []
        """Think time of each answer of the episode."""
        child.socket.setblocking(False)

    def send(self, call: str, tick: int, value: object) -> None:
        """Send a request. An answer that has arrived before it ends the agent."""
        self._call, self._tick = call, tick
        if self._receive_available(1, socket.MSG_PEEK):
            self._fail(FailureReason.INVALID, "expected no answer before the request, found one")
        self._frames.begin()
        limit = "tick" if tick >= 0 else "start"
        data = wire_protocol.encode_frame({"call": call, "tick": tick, "value": value}, self._frames.store)
        self._write(data, _Deadline(time.monotonic() + getattr(self.limits, f"{limit}_s"), limit))
        self._requested_at = time.monotonic()

    def receive(self, read: Callable[[Any], T]) -> T:
        """Return the answer to the last request. read: a function of `reply_decoding` that checks plain values."""
        if self._tick < 0:
            return self._read_answer(_Deadline(time.monotonic() + self.limits.start_s, "start"), read)
        limit_s, limit = min((self.limits.tick_s, "tick"), (self.limits.episode_s - self._used_s, "episode"))
        answer = self._read_answer(_Deadline(self._requested_at + limit_s, limit), read)
        self.think_times_s.append(time.monotonic() - self._requested_at)
        self._used_s += self.think_times_s[-1]
        return answer

    def fail(self, failure: FailureReason, text: str) -> NoReturn:
        """End the process for the content of its answers; raises AgentFailure."""
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
        data, size, most = b"", 0, self.limits.reply_bytes
        while not size or len(data) < wire_protocol.LENGTH.size + size:
            if not self._child.wait_readable(deadline.at_s - time.monotonic()) or (data and _has_passed(deadline)):
                self._fail_late("no answer", deadline)
            received = self._receive_available(min(wire_protocol.LENGTH.size + most + 1, AT_ONCE))
            if not received and _has_passed(deadline):  # readable without data, again and again
                self._fail_late("no answer", deadline)
            data += received
            if not size and len(data) >= wire_protocol.LENGTH.size:
                size = wire_protocol.LENGTH.unpack_from(data)[0]
                if not 0 < size <= most:
                    self._fail(FailureReason.INVALID, f"expected an answer of at most {most} bytes, found {size}")
        if len(data) > wire_protocol.LENGTH.size + size:
            self._fail(FailureReason.INVALID, "expected one answer, found more")
        return data[wire_protocol.LENGTH.size :]

    def _receive_available(self, size: int, flags: int = 0) -> bytes:
        """Return the available bytes, b"" if there are none yet. `recv` drops passed file descriptors."""
        try:
            data = self._child.socket.recv(size, flags)
        except BlockingIOError:
            return b""
        except ConnectionResetError:
            data = b""
        return data or self._fail_process_ended()

    def _write(self, data: bytes, deadline: _Deadline) -> None:
        """Send bytes within the agent's time limit: it may have stopped reading."""
        left = memoryview(data)
        while left:
            try:
                left = left[self._child.socket.send(left) :]
            except BlockingIOError:
                self._wait_for_room(deadline)
            except (BrokenPipeError, ConnectionResetError):
                self._fail_process_ended()

    def _wait_for_room(self, deadline: _Deadline) -> None:
        while not select.select([], [self._child.socket], [], 0.01)[1]:
            if _has_passed(deadline):
                self._fail_late("the agent does not read", deadline)
            self._child.wait_readable(0.0)  # its output must be drained, or it blocks

    def _fail_process_ended(self) -> NoReturn:
        how = self._child.describe_exit() if self._open else "it was ended"
        self._fail(FailureReason.CRASHED, f"the agent's process ended ({how})")

    def _fail_late(self, what: str, deadline: _Deadline) -> NoReturn:
        self._fail(FailureReason.TIMEOUT, f"{what} within {self.limits.describe_time(deadline.limit)}")

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
            },
            **self._child.usage_record(),
        }


def _has_passed(deadline: _Deadline) -> bool:
    return time.monotonic() > deadline.at_s


def _count_up_to(thought_ms: list[float]) -> list[int]:
    """Return how many of the sorted times are within each upper end of the histogram."""
    return [bisect.bisect_right(thought_ms, end) for end in HISTOGRAM_MS]
