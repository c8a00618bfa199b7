"""A server for the tests of the API: an in-memory client, a database of its own, a clock that stands still."""

import socket
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any

import uvicorn
from httpx import Response

from server.cli.limited_protocol import limit_listener
from server.clock import DAY_US
from server.enums import TokenScope
from server.environments import ABOUT_FILE
from server.settings import ArchiveSettings, ServerSettings, WebhookSettings
from server.store import Store, phases, teams, tokens
from server.store.phases import NewPhase
from testing import archive_samples, databases
from testing.api_client import Client
from testing.shared_apps import take_app, take_app_with_pages
from testing.store_samples import JOBS, NOON, PHASE

API = "/api/v1"
HIDDEN = NewPhase("test", "Test", "/srv/secret/suite-marker", False, 0, 30_000 * DAY_US, 3, 2, 100)
CLOSED = NewPhase("past", "Past", "interdrive", True, 0, 1_000_000, 3, 2, 100)
ZIP = archive_samples.packed(archive_samples.GOOD)


class FakeSuites:
    """Two scenarios in every phase."""

    def jobs(self, phase: Any) -> list[tuple[str, int]]:
        return list(JOBS)

    def evaluator(self, phase: Any, environment: str) -> dict[str, Any]:
        return {"version": "1"}

    def find_checksum(self, phase: Any, scenario: str) -> str:
        return ""


class Here:
    """Does it at once, in this process."""

    def call(self, seconds: float, deed: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        return deed(*args, **kwargs)

    def close(self) -> None:
        pass


@dataclass
class Server:
    """One, with two teams and an admin."""

    folder: Path
    store: Store = field(default_factory=lambda: databases.emptied("sqlite"))
    archive_bytes: int = 64 * 1024
    now_us: int = NOON

    def __post_init__(self) -> None:
        limits = ArchiveSettings(archive_bytes=self.archive_bytes, start_agents=False)
        hooks = WebhookSettings(enabled=True)
        self.settings = ServerSettings(data=self.folder, limits=limits, webhooks=hooks)
        with self.store.write() as session:
            phases.set_phases(session, [PHASE, HIDDEN, CLOSED], NOON)
            red, blue = (teams.create(session, name, NOON) for name in ("red", "blue"))
            self.red, self.blue = red.id, blue.id
            self.tokens = {
                "red": tokens.issue(session, red, TokenScope.SUBMIT, NOON),
                "blue": tokens.issue(session, blue, TokenScope.SUBMIT, NOON),
                "admin": tokens.issue(session, None, TokenScope.ADMIN, NOON),
                "worker": tokens.issue(session, None, TokenScope.WORKER, NOON),
            }
        self.app = take_app(self.settings, self.store, FakeSuites(), Here(), lambda: self.now_us)
        self.settings.archives.mkdir(parents=True, exist_ok=True)
        with_environment(self.settings)
        self.client = Client(self.app)

    def mount_pages(self) -> None:
        """Serve pages, too."""
        if not hasattr(self.app.state, "error_page"):
            self.app = take_app_with_pages(self.app)
            self.client = Client(self.app)

    def ask(self, method: str, path: str, who: str = "", **more: Any) -> Response:
        """One request, by the holder of a token."""
        headers = more.pop("headers", {}) | ({"Authorization": f"Bearer {self.tokens[who]}"} if who else {})
        return self.client.request(method, API + path, headers=headers, **more)

    def get(self, path: str, who: str = "", **more: Any) -> Any:
        """JSON of a GET that must succeed."""
        answer = self.ask("GET", path, who, **more)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def send(self, who: str = "red", data: bytes = ZIP, key: str = "", **fields: str) -> Response:
        """An upload."""
        form = {"phase": "dev", "track": "single-agent", "name": "method"} | fields
        headers = {"Idempotency-Key": key} if key else {}
        files = {"archive": ("team.zip", data, "application/zip")}
        return self.ask("POST", "/submissions", who, data=form, files=files, headers=headers)


def with_environment(settings: ServerSettings, name: str = "python3.11-numpy") -> None:
    """An environment that is built, as far as the API looks."""
    about = settings.environments / name / ABOUT_FILE
    about.parent.mkdir(parents=True, exist_ok=True)
    about.write_text("{}")


@contextmanager
def listening(server: Server, **options: Any) -> Generator[str]:
    """The application behind a real HTTP server; its address. `options`: of uvicorn; with `http` as `serve` listens."""
    http = uvicorn.Server(uvicorn.Config(server.app, port=0, log_level="critical", lifespan="off", **options))
    sockets = [limit_listener(socket.create_server(("127.0.0.1", 0)), options["http"])] if "http" in options else None
    thread = Thread(target=http.run, args=(sockets,), daemon=True)
    thread.start()
    deadline_s = time.monotonic() + 60
    while not http.started:
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    yield f"http://127.0.0.1:{http.servers[0].sockets[0].getsockname()[1]}"
    http.should_exit = True
    thread.join(30)


def another_zip(number: int) -> bytes:
    """Other bytes for every number."""
    return archive_samples.packed({**archive_samples.GOOD, "src/number.txt": str(number).encode()})


def problem(answer: Response, status: int, *words: str) -> dict[str, Any]:
    """Asserts that it is one, with these words in its sentence."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    found = answer.json()
    assert found["status"] == status and found["type"].startswith("urn:mdrive-sumo:problem:") and found["title"]
    for word in words:
        assert word in found["detail"], found["detail"]
    return found
