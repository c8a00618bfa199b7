"""Repeated requests for leaderboards are answered from memory, before any route, dependency or token is looked at.

An entry is one finished answer: headers with an ETag, and the body. It is sent for a second; then one request goes to
the application, which has the board ready (`LeaderboardCache`). Requests with a token are never answered from here.
"""

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

Headers = list[tuple[bytes, bytes]]
TTL_US = 1_000_000
"""Age up to which an answer is sent again [us]; also the `max-age` of the answer."""
MAX_ENTRIES = 256
"""Answers in memory, each up to some 100 kB: clients can ask for any number of different views."""
CACHE_CONTROL = b"public, max-age=1"
_KEPT_WITH_304 = (b"etag", b"cache-control", b"vary", b"x-content-type-options")


@dataclass(frozen=True, slots=True)
class CachedResponse:
    """An answer as it is sent."""

    headers: Headers
    etag: bytes
    body: bytes
    made_us: int
    generation: int


class ResponseCacheMiddleware:
    """Answers GET requests without a token for some paths from memory."""

    def __init__(
        self,
        app: ASGIApp,
        is_cached_path: Callable[[str], bool],
        now: Callable[[], int],
        generation: Callable[[], int],
    ) -> None:
        """`generation`: a number that changes when all answers become invalid at once."""
        self._app, self._is_cached_path, self._now, self._generation = app, is_cached_path, now, generation
        self._entries: dict[tuple[str, bytes, bytes], CachedResponse] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http" or scope["method"] != "GET" or not self._is_cached_path(scope["path"]):
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        if b"authorization" in headers or b"cookie" in headers:
            await self._app(scope, receive, send)
            return
        key = scope["path"], scope["query_string"], headers.get(b"hx-request", b"")
        entry = self._entries.get(key)
        if entry is None or not self._is_fresh(entry):
            recorder = _Recorder(send)
            made_us, generation = self._now(), self._generation()
            await self._app(scope, receive, recorder.record)
            if not recorder.is_complete:
                return
            entry = _make_entry(recorder, made_us, generation)
            if len(self._entries) >= MAX_ENTRIES:
                self._entries.clear()
            self._entries[key] = entry
        await _send_entry(entry, headers.get(b"if-none-match"), send)

    def _is_fresh(self, entry: CachedResponse) -> bool:
        return abs(self._now() - entry.made_us) < TTL_US and entry.generation == self._generation()


class _Recorder:
    """Keeps a successful answer, and passes any other one on."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self._chunks: list[bytes] = []
        self._is_kept = False
        self.headers: Headers = []
        self.is_complete = False

    @property
    def body(self) -> bytes:
        """The whole body."""
        return b"".join(self._chunks)

    async def record(self, message: Message) -> None:
        """ASGI's `send`."""
        if message["type"] == "http.response.start":
            self._is_kept = message["status"] == HTTPStatus.OK
            self.headers = list(message["headers"])
        if not self._is_kept:
            await self._send(message)
        elif message["type"] == "http.response.body":
            self._chunks.append(message.get("body", b""))
            self.is_complete = not message.get("more_body", False)


def _make_entry(recorder: _Recorder, made_us: int, generation: int) -> CachedResponse:
    body = recorder.body
    etag = b'"%s"' % hashlib.sha256(body).hexdigest()[:32].encode()
    kept = [(name, value) for name, value in recorder.headers if name.lower() not in (b"cache-control", b"etag")]
    return CachedResponse([*kept, (b"etag", etag), (b"cache-control", CACHE_CONTROL)], etag, body, made_us, generation)


async def _send_entry(entry: CachedResponse, if_none_match: bytes | None, send: Send) -> None:
    status, headers, body = HTTPStatus.OK, entry.headers, entry.body
    if if_none_match is not None and entry.etag in _parse_etags(if_none_match):
        status, body = HTTPStatus.NOT_MODIFIED, b""
        headers = [(name, value) for name, value in headers if name.lower() in _KEPT_WITH_304]
    await send({"type": "http.response.start", "status": int(status), "headers": headers})
    await send({"type": "http.response.body", "body": body})


def _parse_etags(header: bytes) -> Iterable[bytes]:
    """Return the tags of `If-None-Match`, compared weakly (RFC 9110, section 13.1.2)."""
    return {tag.strip().removeprefix(b"W/") for tag in header.split(b",")}
