"""BrowserConnection: one browser of a drive: what is to be sent to it, and how much it may send."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from server.drive.access import Seat, SeatRole
from server.drive.messages import DriveAnswer, TreeOut, WaitingOut, encode_answer, format_problem
from server.drive.protocol import (
    NO_STATE,
    ROW,
    WireFrame,
    encode_frame,
)
from server.drive.simulation_values import DriveFrame

MAX_WAITING_TEXTS = 200
"""Text messages that wait for a browser which does not read; beyond it the connection is closed."""
MAX_WAITING_ROWS = {"messages": 500, "collisions": 50}
"""V2X messages and collisions that a browser which reads slowly is shown later; of more, the oldest are left out."""
REPLACED = (TreeOut, WaitingOut)
"""Messages of which each tells everything that the one before it did."""
INPUTS_PER_S = 120.0
"""Binary messages: twice as many as the fastest page sends, which is one a picture at 60 pictures a second."""
REQUESTS_PER_S = 20.0
"""Text messages: a person who presses buttons, and pings."""
BURST_S = 2.0
"""Time whose allowance may come at once [s], as after a pause of the network."""
MAX_REFUSED = 500
"""Messages beyond the allowance, in all, after which the connection is closed: no page of ours sends that many."""
POLICY_VIOLATION, TRY_AGAIN_LATER, GOING_AWAY, NORMAL = 1008, 1013, 1001, 1000
"""Codes with which a WebSocket is closed (RFC 6455, section 7.4.1, and the registry of IANA)."""


@dataclass(frozen=True, slots=True)
class Closing:
    """Why a connection is closed."""

    code: int
    reason: str


class Allowance:
    """How many messages may come: so many a second, and those of `BURST_S` at once."""

    def __init__(self, per_s: float, now_s: float) -> None:
        self._per_s = per_s
        self._left = per_s * BURST_S
        self._at_s = now_s

    def take(self, now_s: float) -> bool:
        """Count a message; return whether it is within the allowance."""
        self._left = min(self._per_s * BURST_S, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class BrowserConnection:
    """What waits to be sent to one browser, and what it has sent.

    Only the newest frame waits: a browser that cannot keep up misses frames, but nothing of what was new in them. Of
    messages that tell everything anew, such as the tree of takes, only the newest waits, too.
    """

    def __init__(self, seat: Seat, clock: Callable[[], float]) -> None:
        """clock: monotonic time [s]."""
        self.seat = seat
        self._clock = clock
        self.heard_s = clock()
        """Time of its last message [s]."""
        self.input_number = 0
        self.latency_ms: float | None = None
        self._refused = 0
        self._refused_at_s = -1.0
        self._inputs = Allowance(INPUTS_PER_S, self.heard_s)
        self._requests = Allowance(REQUESTS_PER_S, self.heard_s)
        self._texts: deque[str] = deque()
        self._newest: dict[type[DriveAnswer], DriveAnswer] = {}
        """Of the messages that replace each other (`REPLACED`)."""
        self._frame: DriveFrame | None = None
        self._extra: dict[str, Any] = {}
        self._take = 0
        self._closing: Closing | None = None
        self._wake = asyncio.Event()

    @property
    def cav(self) -> str:
        """Its CAV; "" for spectators."""
        return self.seat.cav

    @property
    def is_driver(self) -> bool:
        """Whether a person drives with it."""
        return self.seat.role == SeatRole.DRIVER

    @property
    def is_closing(self) -> bool:
        """Whether nothing more is sent to it."""
        return self._closing is not None

    def put(self, *answers: DriveAnswer) -> None:
        """Queue text messages; one of `REPLACED` takes the place of the one that waits."""
        for answer in answers:
            if isinstance(answer, REPLACED):
                self._newest[type(answer)] = answer
                self._wake.set()
            else:
                self._put_text(encode_answer(answer))

    def put_problem(self, text: str) -> None:
        """Queue one sentence on what was refused."""
        self._put_text(format_problem(text))

    def _put_text(self, text: str) -> None:
        if len(self._texts) >= MAX_WAITING_TEXTS:
            self.close(TRY_AGAIN_LATER, "the browser does not read what it is sent")
            return
        self._texts.append(text)
        self._wake.set()

    def put_frame(self, frame: DriveFrame, known: Mapping[str, Any], is_shown: Callable[[str], bool]) -> None:
        """Replace the frame that waits.

        known: what frames of the take have said so far, for a browser that has seen none of them. is_shown: whether
        V2X messages of a kind are shown.
        """
        messages = [
            message
            for message in frame.extra.get("messages", ())
            if is_shown(message["kind"]) and (not self.is_driver or self.cav in message.get("to", ()))
        ]
        if frame.take != self._take:
            self._take = frame.take
            self._extra = {key: value for key, value in known.items() if value}
        new: dict[str, Any] = {**frame.extra, "messages": messages}
        for key, value in new.items():
            if value or key == "factor":
                self._extra[key] = _merge(key, self._extra.get(key), value)
        self._frame = frame
        self._wake.set()

    def close(self, code: int, reason: str) -> None:
        """Close the connection after what waits, without it if the browser does not read."""
        if self._closing is None:
            self._closing = Closing(code, reason)
        self._wake.set()

    async def take_next(self) -> list[bytes | str] | Closing:
        """Wait for and return what is to be sent, or how to close."""
        while not (self._texts or self._newest or self._frame or self._closing):
            self._wake.clear()
            await self._wake.wait()
        out: list[bytes | str] = [*self._texts, *map(encode_answer, self._newest.values())]
        self._texts.clear()
        self._newest.clear()
        if self._frame is not None:
            out.append(self._encode(self._frame))
        if not out and self._closing is not None:
            return self._closing
        return out

    def _encode(self, frame: DriveFrame) -> bytes:
        extra, self._extra, self._frame = self._extra, {}, None
        own = frame.own.get(self.cav, NO_STATE) if self.is_driver else NO_STATE
        ack = frame.acks.get(self.cav, 0) if self.is_driver else 0
        rows = np.frombuffer(frame.rows, ROW)
        return encode_frame(WireFrame(frame.state, frame.tick, frame.take, ack, own, rows, extra))

    def allow(self, message: bytes | str) -> bool:
        """Count a message of the browser; return whether it is within its allowance.

        The browser is told at most once a second; one that does not stop is closed.
        """
        now_s = self._clock()
        self.heard_s = now_s
        if (self._inputs if isinstance(message, bytes) else self._requests).take(now_s):
            return True
        self._refused += 1
        if self._refused > MAX_REFUSED:
            self.close(POLICY_VIOLATION, "too many messages")
        elif now_s - self._refused_at_s >= 1.0:
            self._refused_at_s = now_s
            limit = f"{INPUTS_PER_S:.0f} inputs" if isinstance(message, bytes) else f"{REQUESTS_PER_S:.0f} messages"
            self.put_problem(f"expected at most {limit} a second; those beyond are dropped")
        return False


def _merge(key: str, old: Any, new: Any) -> Any:
    """Return what is new in two frames together."""
    if key == "names":
        return [*{row[0]: row for row in (*(old or ()), *new)}.values()]
    if key in MAX_WAITING_ROWS:
        return [*(old or ()), *new][-MAX_WAITING_ROWS[key] :]
    return {**(old or {}), **new} if isinstance(new, Mapping) else new
