"""An agent's process that is none: tests play the other end of its line."""

import select
import socket
import time
from collections.abc import Mapping
from typing import Any

from mdrive_sumo.agent_process.wire_protocol import LENGTH


class FakeChild:
    """A process that is none: `theirs` is its end of the line; with `drip` it sends a byte whenever one waits."""

    log_fd = -1

    def __init__(self) -> None:
        self.socket, self.theirs = socket.socketpair()
        self.drip = b""
        self.false_alarms = 0
        self.closed = 0

    def wait_readable(self, timeout_s: float) -> bool:
        if self.false_alarms:
            self.false_alarms -= 1
            time.sleep(0.01)
            return True
        if self.drip:
            time.sleep(0.02)
            self.theirs.send(self.drip[:1])
            self.drip = self.drip[1:]
        return bool(select.select([self.socket], [], [], max(timeout_s, 0.0))[0])

    def describe_exit(self) -> str:
        return "exit code 7"

    def close(self) -> None:
        self.closed += 1
        self.socket.close()

    def usage_record(self) -> Mapping[str, Any]:
        return {"exit_code": 7}


def framed(data: bytes) -> bytes:
    return LENGTH.pack(len(data)) + data
