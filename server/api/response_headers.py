"""Headers that every answer has, whoever makes it; and HEAD, which asks for nothing else."""

from collections.abc import Iterable
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_API = "/api/"
_BARE = {HTTPStatus.NO_CONTENT, HTTPStatus.NOT_MODIFIED}


class ResponseHeadersMiddleware:
    """Nobody guesses a content type, and nobody keeps what only one team may see."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http":
            return await self._app(scope, receive, send)

        async def completed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_missing_headers(scope, message)]
            await send(message)

        if scope["method"] == "HEAD" and not scope["path"].endswith("/events"):  # the server sends no body with it
            return await self._app({**scope, "method": "GET"}, receive, completed)
        return await self._app(scope, receive, completed)


def _missing_headers(scope: Scope, start: Message) -> Iterable[tuple[bytes, bytes]]:
    there = {name.lower() for name, _ in start["headers"]}
    if b"x-content-type-options" not in there and start["status"] not in _BARE:
        yield b"x-content-type-options", b"nosniff"
    if b"cache-control" not in there and scope["path"].startswith(_API):
        # `no-cache` may be kept, but is asked for again each time: what everybody may see today may be hidden tomorrow.
        named = any(name == b"authorization" for name, _ in scope["headers"])
        yield b"cache-control", b"no-store" if named else b"no-cache"
