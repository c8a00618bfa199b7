"""Live events of a submission: server-sent events (WHATWG HTML, section 9.2).

A client that reconnects with `Last-Event-ID` gets the events that it missed. A stream ends with the submission, when
its token is revoked, or after some minutes.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, Mapping
from typing import Annotated, Any, NamedTuple

from fastapi import APIRouter, Header, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from server.api import submission_views
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.dependencies import AnyCaller, Caller, Services, ServicesDep
from server.api.problems import document_problems
from server.api.schemas.parameters import Id
from server.store import StoreUnavailable, submissions, tokens
from server.store.quota import UNFINISHED

router = APIRouter(tags=["submissions"])
POLL_S = 1.0
"""Pause between two looks of a stream at its submission [s]."""
QUIET_POLLS = 15
"""Polls without an event after which a comment is sent, so that proxies keep the connection open."""
MAX_POLLS = 900
"""Polls after which the stream ends and the client reconnects: abandoned streams do not stay open."""
PAGE = 500
"""Events that are read at a time; a stream that begins late gets the rest at once."""
MEDIA_TYPE = "text/event-stream"
_TEXT = {"type": "string"}
_EVENT = {
    "type": "object",
    "required": ["data"],
    "properties": {"id": _TEXT, "event": _TEXT, "data": _TEXT | {"contentMediaType": "application/json"}},
}
LastEventId = Annotated[int, Header(alias="Last-Event-ID", ge=0, le=2**31 - 1)]


class EventBatch(NamedTuple):
    """New events, read in one transaction so that none is missed."""

    events: list[tuple[int, str, Mapping[str, Any]]]
    """Id, kind and data of those that may be disclosed."""
    last: int
    """Id of the last event, disclosed or not."""
    has_more: bool
    """Whether further events are available at once."""
    is_finished: bool
    is_revoked: bool = False
    """Whether the caller's token has been revoked since; then there are no events."""


@router.get(
    "/submissions/{submission}/events",
    response_class=StreamingResponse,
    responses=document_problems(401, 404, 422, 429)
    | {
        200: {"description": "Events.", "content": {MEDIA_TYPE: {"itemSchema": _EVENT}}},
        204: {"description": "It is finished, and you have seen all: do not come back."},
    },
)
async def follow(submission: Id, caller: AnyCaller, services: ServicesDep, last_event_id: LastEventId = 0) -> Response:
    """Live events, for its team and admins. `state` says how the submission stands, `scenario` one result."""
    await services.event_watch.begin(services.store)
    first = await run_in_threadpool(_read_events, services, caller, submission, last_event_id)
    if first.is_finished and not first.events:
        return Response(status_code=204)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    stream = _stream_events(services, caller, submission, first)
    return _LimitedStream(
        services.stream_limit, caller.team or caller.token, stream, media_type=MEDIA_TYPE, headers=headers
    )


class _LimitedStream(StreamingResponse):
    """A stream that counts against the limits of its team and of all teams while it is being sent."""

    def __init__(self, limit: ConcurrencyLimit, key: str, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._slot = limit.acquire(key)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI. Raises ProblemError (429 or 503) before anything is sent."""
        with self._slot:
            await super().__call__(scope, receive, send)


async def _stream_events(services: Services, caller: Caller, submission: str, batch: EventBatch) -> AsyncGenerator[str]:
    quiet = 0
    for _ in range(MAX_POLLS):
        for number, kind, data in batch.events:
            yield f"id: {number}\nevent: {kind}\ndata: {json.dumps(data, separators=(',', ':'))}\n\n"
        quiet = 0 if batch.events else quiet + 1
        if batch.is_finished or batch.is_revoked:
            return
        if quiet >= QUIET_POLLS:
            quiet = 0
            yield ": keep-alive\n\n"
        await asyncio.sleep(0 if batch.has_more else POLL_S)
        try:
            batch = await _read_news(services, caller, submission, batch)
        except StoreUnavailable:
            return  # the client reconnects, and misses no event


async def _read_news(services: Services, caller: Caller, submission: str, batch: EventBatch) -> EventBatch:
    """Return the events after a batch; the database is asked only if there are any."""
    is_due = batch.has_more or await services.event_watch.has_news(services.store, submission, batch.last, caller.token)
    if is_due:
        return await run_in_threadpool(_read_events, services, caller, submission, batch.last)
    return EventBatch([], batch.last, has_more=False, is_finished=False)


def _read_events(services: Services, caller: Caller, submission_id: str, after: int) -> EventBatch:
    with services.store.read() as session:
        if not tokens.is_valid(session, caller.token):
            return EventBatch([], after, has_more=False, is_finished=False, is_revoked=True)
        submission = submission_views.find_own(session, caller, submission_id)
        phase = submission_views.get_phase(session, submission)
        news = submissions.list_events(session, submission_id, after, PAGE)
        disclosed = [
            (event.id, event.kind, submission_views.visible_event(phase, event.kind, event.data)) for event in news
        ]
        return EventBatch(
            events=[(number, kind, data) for number, kind, data in disclosed if data is not None],
            last=news[-1].id if news else after,
            has_more=len(news) == PAGE,
            is_finished=submission.state not in UNFINISHED and len(news) < PAGE,
        )
