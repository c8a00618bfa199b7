"""What happens to a submission, as it happens: server-sent events (WHATWG HTML, section 9.2).

Whoever comes back with `Last-Event-ID` gets what was missed. A stream ends with the submission, or after some minutes.
"""

import asyncio
import json
from collections.abc import AsyncGenerator, Mapping
from typing import Annotated, Any, NamedTuple

from fastapi import APIRouter, Header, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from server.api import schemas, submission_views
from server.api.concurrency_limit import ConcurrencyLimit
from server.api.dependencies import AnyCaller, Caller, Services, ServicesDep
from server.api.problems import document_problems
from server.store import StoreUnavailable, events
from server.store.quota import UNFINISHED

router = APIRouter(tags=["submissions"])
POLL_S = 1.0
QUIET_POLLS = 15
"""After so many without news a comment is sent, so that nobody between us takes the line for dead."""
MOST_POLLS = 900
"""Then the client has to come back: a stream that nobody reads any more does not stay for ever."""
PAGE = 500
MEDIA_TYPE = "text/event-stream"
_TEXT = {"type": "string"}
_EVENT = {
    "type": "object",
    "required": ["data"],
    "properties": {"id": _TEXT, "event": _TEXT, "data": _TEXT | {"contentMediaType": "application/json"}},
}
LastEventId = Annotated[int, Header(alias="Last-Event-ID", ge=0, le=2**31 - 1)]


class EventBatch(NamedTuple):
    """What is new, read in one transaction, so that no event can fall between."""

    told: list[tuple[int, str, Mapping[str, Any]]]
    """Id, kind and data of those that may be told."""
    last: int
    """Id of the last of all."""
    more: bool
    """At once."""
    finished: bool


@router.get(
    "/submissions/{submission}/events",
    response_class=StreamingResponse,
    responses=document_problems(401, 404, 422, 429)
    | {
        200: {"description": "Events.", "content": {MEDIA_TYPE: {"itemSchema": _EVENT}}},
        204: {"description": "It is finished, and you have seen all: do not come back."},
    },
)
async def follow(
    submission: schemas.Id, caller: AnyCaller, using: ServicesDep, last_event_id: LastEventId = 0
) -> Response:
    """Live events, for its team and admins. `state` says how the submission stands, `scenario` one result."""
    first = await run_in_threadpool(_read_events, using, caller, submission, last_event_id)
    if first.finished and not first.told:
        return Response(status_code=204)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    stream = _stream_events(using, caller, submission, first)
    return _LimitedStream(using.streams, caller.team or caller.token, stream, media_type=MEDIA_TYPE, headers=headers)


class _LimitedStream(StreamingResponse):
    """One of a few of its team, as long as it is being sent; refused where there are too many."""

    def __init__(self, streams: ConcurrencyLimit, of: str, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._place = streams.another(of)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI. Raises ProblemError, before anything is sent."""
        with self._place:
            await super().__call__(scope, receive, send)


async def _stream_events(using: Services, caller: Caller, submission: str, news: EventBatch) -> AsyncGenerator[str]:
    quiet = 0
    for _ in range(MOST_POLLS):
        for number, kind, data in news.told:
            yield f"id: {number}\nevent: {kind}\ndata: {json.dumps(data, separators=(',', ':'))}\n\n"
        quiet = 0 if news.told else quiet + 1
        if news.finished:
            return
        if quiet >= QUIET_POLLS:
            quiet = 0
            yield ": still here\n\n"
        await asyncio.sleep(0 if news.more else POLL_S)
        try:
            news = await run_in_threadpool(_read_events, using, caller, submission, news.last)
        except StoreUnavailable:
            return  # the client comes back by itself, and nothing is lost


def _read_events(using: Services, caller: Caller, submission_id: str, after: int) -> EventBatch:
    with using.store.read() as session:
        submission = submission_views.find_own(session, caller, submission_id)
        phase = submission_views.get_phase(session, submission)
        found = events.list_since(session, submission_id, after, PAGE)
        told = [
            (event.id, event.kind, submission_views.visible_event(phase, event.kind, event.data)) for event in found
        ]
        return EventBatch(
            told=[(number, kind, data) for number, kind, data in told if data is not None],
            last=found[-1].id if found else after,
            more=len(found) == PAGE,
            finished=submission.state not in UNFINISHED and len(found) < PAGE,
        )
