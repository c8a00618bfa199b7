"""The participants' commands as if installed, and a server of a few lines to submit to. No tests in here."""

import json
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from email import message_from_bytes
from email.message import Message
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import EntryPoint
from typing import Any

import pytest
from click.testing import CliRunner, Result

from mdrive_sumo.cli import command_line as cli

COMMANDS = {
    "init-agent": "server.participant.init_agent:init_agent",
    "cancel": "server.participant.manage:cancel",
    "results": "server.participant.manage:results",
    "check": "server.participant.check:check",
    "submit": "server.participant.submit:submit",
}
Run = Callable[..., Result]
Refusal = tuple[int, dict[str, Any], dict[str, str]]
"""Status, problem and headers of the answer to an upload."""


def command_line(monkeypatch: pytest.MonkeyPatch) -> Run:
    """`mdrive-sumo` with these commands plugged in."""
    points = {name: EntryPoint(name, value, cli.PLUG_IN_GROUP) for name, value in COMMANDS.items()}
    monkeypatch.setattr(cli, "find_plug_ins", lambda _group: points)
    return lambda *words: CliRunner().invoke(cli.main, [str(word) for word in words])


OPEN = {"id": "warm-up", "open": True}
CLOSED = {"id": "test", "open": False}


@dataclass
class Fake:
    """What it answers, and what it was told."""

    url: str = ""
    phases: list[dict[str, Any]] = field(default_factory=lambda: [OPEN, CLOSED])
    refusal: Refusal | None = None
    lost: int = 0
    """How many uploads break off."""
    away: int = 0
    """How many other requests are not answered."""
    streams: list[list[tuple[str, dict[str, Any]]]] = field(default_factory=lambda: [[("state", {"state": "done"})]])
    """Events of one connection after the other."""
    shown: dict[str, Any] = field(default_factory=lambda: {"id": "s1", "state": "queued"})
    uploads: list[tuple[dict[str, str], dict[str, bytes]]] = field(default_factory=list)
    """Headers and fields."""
    after: list[str] = field(default_factory=list)
    """Last-Event-ID of each connection."""


class Handler(BaseHTTPRequestHandler):
    """Answers as the fake says."""

    fake: Fake
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        pass

    def answer(self, status: int, content: dict[str, Any], headers: dict[str, str] | None = None) -> None:
        data = json.dumps(content).encode()
        self.send_response(status)
        for name, value in {"Content-Length": str(len(data)), **(headers or {})}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(data)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        kind = f"Content-Type: {self.headers['Content-Type']}\n\n".encode()
        parts = message_from_bytes(kind + body).get_payload()
        fields = {
            part.get_param("name", header="content-disposition"): part.get_payload(decode=True)
            for part in parts
            if isinstance(part, Message)
        }
        self.fake.uploads.append((dict(self.headers), fields))
        if self.fake.lost:
            self.fake.lost -= 1
            self.close_connection = True
            return
        status, content, headers = self.fake.refusal or (201, self.fake.shown, {})
        self.answer(status, content, headers)

    def do_GET(self) -> None:
        if self.fake.away:
            self.fake.away -= 1
            self.close_connection = True
        elif self.path.endswith("/phases"):
            self.answer(200, {"items": self.fake.phases})
        elif self.path.endswith("/events"):
            self.stream()
        elif self.path == "/api/v1/submissions/s1":
            self.answer(200, self.fake.shown)
        else:
            self.answer(404, {"title": "no such thing"})

    def stream(self) -> None:
        self.fake.after.append(self.headers.get("Last-Event-ID", ""))
        events = self.fake.streams.pop(0) if self.fake.streams else []
        self.send_response(200)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(b": hello\n\n")
        for kind, data in events:
            number = len(self.fake.after) * 10
            self.wfile.write(f"id: {number}\nevent: {kind}\ndata: {json.dumps(data)}\n\n".encode())
        self.close_connection = True


@contextmanager
def serving(fake: Fake) -> Generator[Fake]:
    """Runs it."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Mine", (Handler,), {"fake": fake}))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    fake.url = f"http://127.0.0.1:{server.server_address[1]}"
    try:
        yield fake
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
