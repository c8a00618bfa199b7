"""Headers of every response, and support for HEAD."""

from collections.abc import Iterable
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_API = "/api/"
_WITHOUT_BODY = {HTTPStatus.NO_CONTENT, HTTPStatus.NOT_MODIFIED}


class ResponseHeadersMiddleware:
    """Adds `nosniff` and cache headers to every response that lacks them; answers HEAD as GET without a body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http":
            return await self._app(scope, receive, send)

        async def send_completed(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_missing_headers(scope, message)]
            await send(message)

        if scope["method"] == "HEAD" and not scope["path"].endswith("/events"):  # uvicorn drops the body
            return await self._app({**scope, "method": "GET"}, receive, send_completed)
        return await self._app(scope, receive, send_completed)


def _missing_headers(scope: Scope, start: Message) -> Iterable[tuple[bytes, bytes]]:
    present = {name.lower() for name, _ in start["headers"]}
    if b"x-content-type-options" not in present and start["status"] not in _WITHOUT_BODY:
        yield b"x-content-type-options", b"nosniff"
    if b"cache-control" not in present and scope["path"].startswith(_API):
        # `no-cache`: a client may store the response but must revalidate, because visible data may become hidden.
        has_token = any(name == b"authorization" for name, _ in scope["headers"])
        yield b"cache-control", b"no-store" if has_token else b"no-cache"
