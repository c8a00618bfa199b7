"""HTTP client of a challenge server; every error is one sentence."""

import json
import time
import uuid
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any, BinaryIO, cast

import httpx

from mdrive_sumo.core.errors import InputError
from server.enums import ChallengeTrack

API = "/api/v1"
TRIES = 3
"""Attempts of an upload; the idempotency key makes them one submission."""
WAIT_S = 5
"""Wait between attempts if the server does not say how long [s]."""
MAX_WAIT_S = 60
"""Longest wait between attempts [s]."""
TIMEOUT = httpx.Timeout(30.0, read=60.0)
"""Time limits of connecting and writing, and of an answer: a check of an archive takes up to 20 s and may wait [s]."""
OnBytesSent = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class SubmissionForm:
    """Form fields of an upload besides the archive."""

    phase: str
    track: ChallengeTrack
    name: str


class ServerUnreachable(InputError):
    """The server cannot be reached or is busy; a later attempt can succeed."""

    def __init__(self, sentence: str, after_s: int | None = None) -> None:
        """`after_s`: seconds after which to try again, if the server says so."""
        super().__init__(sentence)
        self.after_s = after_s


class ChallengeClient:
    """Connection to one server with one token. Methods raise InputError, `ServerUnreachable` for temporary errors."""

    def __init__(self, server: str, token: str, transport: httpx.BaseTransport | None = None) -> None:
        """`server`: its address, http:// or https://."""
        if not server.startswith(("http://", "https://")):
            raise InputError(f"server: expected an address that begins with http:// or https://, found {server!r}")
        if not (token.isascii() and token.isprintable()):
            raise InputError("token: expected the one that the server gave your team, found other characters in it")
        headers = {"Authorization": f"Bearer {token}", "Accept": "application/json"}
        self._server = server.rstrip("/")
        try:
            self._http = httpx.Client(
                base_url=self._server + API, headers=headers, timeout=TIMEOUT, transport=transport
            )
        except httpx.InvalidURL as error:
            raise InputError(f"server: expected an address, found {server!r}: {_describe(error)}") from None

    def __enter__(self) -> "ChallengeClient":
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def page(self, submission: str) -> str:
        """Return the address of a submission's web page."""
        return f"{self._server}/submissions/{submission}"

    def open_phase(self) -> str:
        """Return the only open public phase; hidden ones, whose quota is small, must be named.

        Raises InputError if there is none or more than one.
        """
        rows = cast("list[Mapping[str, Any]]", self._json("GET", "/phases")["items"])
        phases = {str(row["id"]): bool(row.get("public", True)) for row in rows if row.get("open")}
        public = [name for name, is_public in phases.items() if is_public]
        if len(public) != 1:
            names = ", ".join(name if is_public else f"{name} (hidden)" for name, is_public in phases.items())
            raise InputError(f"{self._server}: expected --phase, one of: {names or 'none is open now'}")
        return public[0]

    def submit(self, archive: Path, entry: SubmissionForm, on_sent: OnBytesSent) -> Mapping[str, Any]:
        """Upload an archive; `on_sent` receives the number of bytes sent.

        Tries again if the connection breaks or the server is busy.
        """
        key = str(uuid.uuid4())
        for left in reversed(range(TRIES)):
            try:
                with archive.open("rb") as file:
                    return self._send(file, entry, key, on_sent)
            except httpx.TransportError as error:
                if not left:
                    raise InputError(f"{self._server}: the upload broke off: {_describe(error)}") from None
            except ServerUnreachable as error:
                if not left:
                    raise
                time.sleep(min(error.after_s or WAIT_S, MAX_WAIT_S))
        raise AssertionError

    def show(self, submission: str) -> Mapping[str, Any]:
        """Return the submission as the API shows it."""
        return self._json("GET", f"/submissions/{submission}")

    def list_submissions(self) -> Sequence[Mapping[str, Any]]:
        """Return the latest submissions of the token's team, the newest first, at most 50."""
        return cast("Sequence[Mapping[str, Any]]", self._json("GET", "/submissions").get("items", ()))

    def cancel(self, submission: str) -> Mapping[str, Any]:
        """Cancel a submission, and return it."""
        return self._json("POST", f"/submissions/{submission}/cancel")

    def scenarios(self, submission: str) -> Sequence[Mapping[str, Any]] | None:
        """Return the scenarios of a submission, None if they are hidden."""
        with self._connection_errors():
            answer = self._http.get(f"/submissions/{submission}/scenarios")
        if answer.status_code == HTTPStatus.FORBIDDEN:
            return None
        return cast("Sequence[Mapping[str, Any]]", self._content(answer).get("items", ()))

    def scenarios_csv(self, submission: str) -> str:
        """Return the scenarios as CSV."""
        with self._connection_errors():
            answer = self._http.get(f"/submissions/{submission}/scenarios.csv")
        if not answer.is_success:
            raise self._refusal(answer)
        return answer.text

    def events(self, submission: str, after: str) -> Generator[tuple[str, str, Mapping[str, Any]]]:
        """Yield id, kind and data of the events after `after` until the connection ends."""
        headers = {"Accept": "text/event-stream"} | ({"Last-Event-ID": after} if after else {})
        with (
            self._connection_errors(),
            self._http.stream("GET", f"/submissions/{submission}/events", headers=headers) as answer,
        ):
            if not answer.is_success:
                answer.read()
                refusal = self._refusal(answer)
                busy = answer.status_code == HTTPStatus.TOO_MANY_REQUESTS  # too many streams of the team
                raise ServerUnreachable(str(refusal)) if busy else refusal
            event: dict[str, str] = {}
            for line in answer.iter_lines():
                name, _, value = line.partition(":")
                if line:
                    event[name] = value.removeprefix(" ")
                elif "data" in event:
                    yield event.get("id", ""), event.get("event", "message"), _parse_object(event["data"])
                    event = {}

    def _send(self, file: BinaryIO, entry: SubmissionForm, key: str, on_sent: OnBytesSent) -> Mapping[str, Any]:
        fields = {"phase": entry.phase, "track": entry.track.value, "name": entry.name}
        answer = self._http.post(
            "/submissions",
            data=fields,
            files={"archive": ("team.zip", cast(BinaryIO, _ProgressFile(file, on_sent)), "application/zip")},
            headers={"Idempotency-Key": key},
        )
        return self._content(answer)

    def _json(self, method: str, path: str) -> Mapping[str, Any]:
        with self._connection_errors():
            return self._content(self._http.request(method, path))

    def _content(self, answer: httpx.Response) -> Mapping[str, Any]:
        if not answer.is_success:
            raise self._refusal(answer)
        return _parse_object(answer.text)

    @contextmanager
    def _connection_errors(self) -> Generator[None]:
        try:
            yield
        except httpx.TransportError as error:
            raise ServerUnreachable(f"{self._server}: cannot be reached: {_describe(error)}") from None

    def _refusal(self, answer: httpx.Response) -> InputError:
        """Return the server's sentence (RFC 9457) if there is one, and when to try again."""
        if answer.has_redirect_location:
            return InputError(f"{self._server} ({answer.status_code}): it has moved to {answer.headers['Location']}")
        try:
            problem = _parse_object(answer.text)
        except InputError:
            problem = {}
        sentence = str(problem.get("detail") or problem.get("title") or answer.reason_phrase or "refused")
        again = answer.headers.get("Retry-After", "")
        wait = f"; try again in {_format_duration(int(again))}" if again.isdecimal() else ""
        sentence = f"{self._server} ({answer.status_code}): {sentence}{wait}"
        if answer.status_code != HTTPStatus.SERVICE_UNAVAILABLE:
            return InputError(sentence)
        return ServerUnreachable(sentence, int(again) if again.isdecimal() else MAX_WAIT_S)


class _ProgressFile:
    """A file that reports the position after each read."""

    def __init__(self, file: BinaryIO, on_sent: OnBytesSent) -> None:
        self._file, self._on_sent = file, on_sent

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        self._on_sent(self._file.tell())
        return data


def _parse_object(text: str) -> Mapping[str, Any]:
    try:
        content = json.loads(text)
    except ValueError:
        content = None
    if not isinstance(content, dict):
        raise InputError(
            f"server: expected a JSON object in its answer, found {text!r:.60}; is this the right address?"
        )
    return cast("Mapping[str, Any]", content)


def _describe(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _format_duration(seconds: int) -> str:
    hours, minutes = divmod(-(-seconds // 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
