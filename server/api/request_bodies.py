"""Bodies of requests: not too large, and read to their end before the answer.

Where an answer comes before the whole upload has been read, the connection is cut, and most clients then report the cut
and not the answer. So what is left is read and thrown away first: as much as an archive may have, for a few seconds.
"""

import asyncio
from collections.abc import Collection
from contextlib import suppress

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

JSON_BYTES = 64 * 1024
"""Of all bodies that are read as a whole, which is before anybody looks at the token."""
JSON_S = 30.0
"""For such a body; who sends a byte a minute has no place here."""
_SECONDS = 10.0


class RequestBodyMiddleware:
    """Limits every body but that of an upload, and drains what is left."""

    def __init__(self, app: ASGIApp, uploads: Collection[str], most: int) -> None:
        """`uploads`: the paths under which the body is read piece by piece, and limited, elsewhere."""
        self._app, self._uploads, self._most = app, uploads, most

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        body = _Body(receive, None if scope["path"] in self._uploads else JSON_BYTES)
        polite = any(name == b"expect" for name, _ in scope["headers"])  # waits to be asked for its body

        async def drained(message: Message) -> None:
            if message["type"] == "http.response.start" and (body.size or not polite):
                await body.drain(self._most)
            await send(message)

        return await self._app(scope, body.receive, drained)


class _Body:
    """Of one request."""

    def __init__(self, receive: Receive, most: int | None) -> None:
        self._receive, self._most = receive, most
        self.size, self._whole = 0, False

    async def receive(self) -> Message:
        """ASGI. Raises HTTPException, the only one that FastAPI lets through from here."""
        if self._most is None or self._whole:
            return await self._next()
        try:
            message = await asyncio.wait_for(self._next(), JSON_S)
        except TimeoutError:
            if self._whole:  # `drain` took its end meanwhile; what is waited for is that the client leaves
                return await self._next()
            raise HTTPException(408, f"body: expected all of it within {JSON_S:.0f} s, found it unfinished") from None
        if self.size > self._most:
            raise HTTPException(413, f"body: expected at most {self._most} bytes, found more")
        return message

    async def drain(self, most: int) -> None:
        """Reads on to the end."""
        left = self.size + most
        with suppress(TimeoutError):
            async with asyncio.timeout(_SECONDS):
                while not self._whole and self.size < left:
                    await self._next()

    async def _next(self) -> Message:
        message = await self._receive()
        self.size += len(message.get("body", b""))
        self._whole = self._whole or not message.get("more_body", False)
        return message
