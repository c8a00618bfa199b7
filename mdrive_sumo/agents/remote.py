"""RemoteDriver: an agent in a child process of its own, so that one that hangs in C code can be ended.

Not a sandbox: the child is as free as the user who started it. Only the clock and the contract are enforced.
"""

import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mdrive_sumo.agents import wire
from mdrive_sumo.agents.driver import AgentFailure, checked, described
from mdrive_sumo.agents.host import LENGTH, framed
from mdrive_sumo.contract import LABELS, Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.state import Failure


@dataclass(frozen=True, slots=True)
class Limits:
    """How long an agent may take, in wall-clock seconds."""

    start_s: float = 60.0
    """To be imported and created, and again to be briefed."""
    tick_s: float = 5.0
    """For one answer."""
    episode_s: float = 600.0
    """For all answers of an episode together."""


class RemoteDriver:
    """A Driver whose agent runs in `host`. Every method raises AgentFailure; after one the child is gone."""

    def __init__(self, locator: str, config: Mapping[str, Any], limits: Limits, log: Path | None = None) -> None:
        """`log`: file for what the agent prints; None throws it away."""
        self._limits = limits
        self._spent_s = 0.0
        self.thought_s = 0.0
        self._asked_at = 0.0
        errors: IO[bytes] | int = log.open("wb") if log is not None else subprocess.DEVNULL
        self._child = subprocess.Popen(  # the child's end is awaited in close()
            [sys.executable, "-m", "mdrive_sumo.agents.host", locator],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
        )
        if not isinstance(errors, int):
            errors.close()
        assert self._child.stdin is not None
        os.set_blocking(self._child.stdin.fileno(), False)
        self._created: dict[str, Any] | None = None
        self._send("create", dict(config))

    @property
    def label(self) -> str:
        """What the agent calls itself."""
        label = self._creation()["label"]
        if label not in LABELS:
            raise self._ended(Failure.INVALID, f"label: expected one of {', '.join(LABELS)}, found {label!r}")
        return label

    def sensors(self) -> tuple[SensorSpec, ...]:
        """See Driver."""
        sensors = self._creation()["sensors"]
        if not isinstance(sensors, tuple) or not all(isinstance(spec, SensorSpec) for spec in sensors):
            raise self._ended(Failure.INVALID, "sensors(): expected a tuple of SensorSpec")
        return sensors

    def start(self, briefing: Briefing) -> None:
        """See Driver."""
        self._send("start", briefing)
        self._receive(self._limits.start_s, "start")

    def ask(self, seen: Observation) -> None:
        """See Driver."""
        self._send("act", seen)
        self._asked_at = time.monotonic()

    def answer(self) -> Reply:
        """See Driver."""
        left_s = self._limits.episode_s - self._spent_s
        reply = self._receive(min(self._limits.tick_s, left_s), "act", self._asked_at)
        self.thought_s = time.monotonic() - self._asked_at
        self._spent_s += self.thought_s
        try:
            return checked(reply)
        except AgentFailure:
            self.close()
            raise

    def close(self) -> None:
        """See Driver."""
        self._child.kill()
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                try:
                    stream.close()
                except BrokenPipeError:  # unsent bytes to a child that is gone
                    continue
        self._child.wait()

    def _creation(self) -> dict[str, Any]:
        created = self._created
        if created is None:
            created = self._created = dict(self._receive(self._limits.start_s, "create"))
        return created

    def _send(self, call: str, value: object) -> None:
        """Writes a request without ever waiting longer than the agent may think: it may have stopped reading."""
        assert self._child.stdin is not None
        data = memoryview(framed({"call": call, "value": value}))
        deadline = time.monotonic() + (self._limits.tick_s if call == "act" else self._limits.start_s)
        try:
            descriptor = self._child.stdin.fileno()
            while data:
                if not select.select([], [descriptor], [], max(deadline - time.monotonic(), 0.0))[1]:
                    raise self._ended(Failure.TIMEOUT, f"{call}: the agent does not read within the time limit")
                data = data[os.write(descriptor, data) :]
        except (BrokenPipeError, ValueError):
            raise self._ended(Failure.CRASHED, f"{call}: the agent's process is gone") from None

    def _receive(self, limit_s: float, call: str, since: float | None = None) -> Any:
        deadline = (time.monotonic() if since is None else since) + limit_s
        size = LENGTH.unpack(self._read(LENGTH.size, deadline, call))[0]
        if size > wire.MAX_BYTES:
            raise self._ended(
                Failure.INVALID, f"{call}: expected an answer of at most {wire.MAX_BYTES} bytes, found {size}"
            )
        try:
            answer = wire.unpacked(self._read(size, deadline, call))
        except wire.WireError as error:
            raise self._ended(Failure.INVALID, f"{call}: {error}") from None
        if "crashed" in answer:
            raise self._ended(Failure.CRASHED, " ".join(answer["crashed"].split())[:200])
        if "invalid" in answer:
            raise self._ended(Failure.INVALID, f"{call}: {answer['invalid']}")
        return answer["value"]

    def _read(self, size: int, deadline: float, call: str) -> bytes:
        assert self._child.stdout is not None
        descriptor, data = self._child.stdout.fileno(), b""
        while len(data) < size:
            ready = select.select([descriptor], [], [], max(deadline - time.monotonic(), 0.0))[0]
            if not ready:
                raise self._ended(Failure.TIMEOUT, f"{call}: no answer within the time limit")
            piece = os.read(descriptor, min(size - len(data), 2**20))
            if not piece:
                raise self._ended(Failure.CRASHED, f"{call}: the agent's process ended (exit code {self._exit_code()})")
            data += piece
        return data

    def _exit_code(self) -> int | str:
        try:
            return self._child.wait(timeout=5)
        except subprocess.TimeoutExpired as error:
            return described(error)

    def _ended(self, failure: Failure, text: str) -> AgentFailure:
        self.close()
        return AgentFailure(failure, text)
