"""A driver without a browser: it speaks the bytes of the page over a WebSocket. No tests in here."""

import json
import socket
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from types import TracebackType
from typing import Any, Self

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from mdrive_sumo.contract import Control
from server.drive.protocol import DriveInput, FrameState, InputDevice, WireFrame, decode_frame, encode_input

LIMIT_S = 120.0
"""Time for what a test waits for, on a busy machine [s]."""


class DriveClient:
    """One connection; sends one input with each frame while the clock runs."""

    def __init__(self, link: str) -> None:
        """link: as `mdrive-sumo drive` prints it."""
        root, _, token = link.partition("?token=")
        address = "ws" + root.removeprefix("http").rsplit("/", 2 if "/drive/" in root else 1)[0]
        self._opened = ExitStack()
        self._socket = self._opened.enter_context(connect(f"{address}/socket?token={token}"))
        self.control = Control(0.3, 0.0, 0.0)
        self.number = 0
        self.frame: WireFrame | None = None
        self.told: list[dict[str, Any]] = []
        self.welcome = json.loads(self._socket.recv(timeout=LIMIT_S))
        assert self.welcome["is"] == "welcome", self.welcome

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.leave()

    def leave(self) -> None:
        """Break the connection without saying so, as a lost network does."""
        with suppress(OSError):
            self._socket.socket.shutdown(socket.SHUT_RDWR)
        self._opened.close()

    def ask(self, **request: Any) -> None:
        self._socket.send(json.dumps(request))

    def receive(self, timeout_s: float = 0.05) -> None:
        """Take one message, if one comes in time."""
        try:
            message = self._socket.recv(timeout=timeout_s)
        except TimeoutError:
            self.ask(do="ping", time=time.monotonic())
            return
        if isinstance(message, str):
            self.told.append(json.loads(message))
            return
        self.frame = decode_frame(message)
        if self.welcome["role"] == "driver" and self.frame.state in (FrameState.RUNNING, FrameState.SLOW):
            self.number += 1
            self._socket.send(encode_input(DriveInput(InputDevice.SCRIPT, self.number, 0.0, self.control)))

    def receive_rest(self) -> None:
        """Take all that the server had sent before it ended, without an answer."""
        with suppress(ConnectionClosed):
            while True:
                message = self._socket.recv(timeout=LIMIT_S)
                if not isinstance(message, str):
                    self.frame = decode_frame(message)

    @property
    def tick(self) -> int:
        return self.frame.tick if self.frame else -1

    @property
    def state(self) -> FrameState | None:
        return self.frame.state if self.frame else None

    def tell(self, kind: str) -> dict[str, Any]:
        """The last message of a kind."""
        return next((one for one in reversed(self.told) if one["is"] == kind), {})

    @property
    def takes(self) -> list[dict[str, Any]]:
        return self.tell("tree").get("takes") or self.welcome["takes"]


def play_until(is_done: Callable[[], bool], *clients: DriveClient) -> None:
    """Let clients drive until something is true."""
    end = time.monotonic() + LIMIT_S
    while not is_done():
        assert time.monotonic() < end, [(one.tick, one.state, one.told[-5:]) for one in clients]
        for client in clients:
            client.receive(0.02)
