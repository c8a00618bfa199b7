"""Limits the size of request bodies, and reads them to their end before the response.

If a response is sent before the whole upload has been read, the connection is closed, and most clients report the
closed connection instead of the response. So the rest of the body is read and discarded first: at most the size of an
archive, for a few seconds.
"""

import asyncio
import time
from collections.abc import Collection
from contextlib import suppress

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

JSON_BYTES = 64 * 1024
"""Size limit of bodies that are read as a whole, which happens before the token is checked [bytes]."""
JSON_S = 30.0
"""Time limit of such a body, against clients that send a byte a minute [s]."""
_DRAIN_S = 10.0
"""Time limit of reading the rest of a body that no route wants [s]: a slow client then misses the answer."""


class RequestBodyMiddleware:
    """Limits every body except uploads, which limit themselves, and drains what is left."""

    def __init__(self, app: ASGIApp, uploads: Collection[str], max_upload: int) -> None:
        """`uploads`: paths whose handlers stream and limit the body; `max_upload` [bytes] bounds what is drained."""
        self._app, self._uploads, self._max_upload = app, uploads, max_upload

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        body = _Body(receive, None if scope["path"] in self._uploads else JSON_BYTES)
        expects_continue = any(name == b"expect" for name, _ in scope["headers"])  # sends its body only on demand

        async def drain_and_send(message: Message) -> None:
            if message["type"] == "http.response.start" and (body.size or not expects_continue):
                await body.drain(self._max_upload)
            await send(message)

        return await self._app(scope, body.receive, drain_and_send)


class _Body:
    """The body of one request, counted as it is read."""

    def __init__(self, receive: Receive, limit: int | None) -> None:
        self._receive, self._limit = receive, limit
        self.size, self._is_complete = 0, False
        self._deadline_s = time.monotonic() + JSON_S

    async def receive(self) -> Message:
        """ASGI. Raises HTTPException, the only exception that FastAPI passes on from here."""
        if self._limit is None or self._is_complete:
            return await self._next()
        try:
            message = await asyncio.wait_for(self._next(), max(0.0, self._deadline_s - time.monotonic()))
        except TimeoutError:
            if self._is_complete:  # `drain` has read the end meanwhile; now the client's disconnection is awaited
                return await self._next()
            raise HTTPException(408, f"body: expected all of it within {JSON_S:.0f} s, found it unfinished") from None
        if self.size > self._limit:
            raise HTTPException(413, f"body: expected at most {self._limit} bytes, found more")
        return message

    async def drain(self, max_bytes: int) -> None:
        """Read and discard the rest, at most `max_bytes`."""
        limit = self.size + max_bytes
        with suppress(TimeoutError):
            async with asyncio.timeout(_DRAIN_S):
                while not self._is_complete and self.size < limit:
                    await self._next()

    async def _next(self) -> Message:
        message = await self._receive()
        self.size += len(message.get("body", b""))
        self._is_complete = self._is_complete or not message.get("more_body", False)
        return message
