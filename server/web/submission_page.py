"""A submission's page: how it stands, live while it is driven, then its result; and what may be done with it."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, Query, Request, Response
from fastapi.responses import RedirectResponse
from sqlalchemy import select

from server.api import schemas, submission_views
from server.api.caller import Caller
from server.api.dependencies import Now, Tools, ToolsOf
from server.api.problems import Hidden
from server.api.routes import results, submissions
from server.enums import JobState
from server.store import tables
from server.store.errors import checked_text
from server.store.quota import UNFINISHED
from server.web import explanations
from server.web.latency_histogram import histogram
from server.web.templating import headers_of, page, render
from server.web.visitor import AdminVisitor, MaybeVisitor, SomeVisitor

router = APIRouter()
NEWS = 12
"""Latest events that the page of an unfinished submission shows."""
SAID_STEP = 10
"""Percent of progress between two announcements to screen readers."""
Order = Literal["scenario", "ds", "rc", "ip", "latency", "memory", "cpu"]
Which = Annotated[str, Query(max_length=20)]
Seen = Annotated[int, Query(ge=0, le=1_000_000)]


@dataclass(frozen=True, slots=True)
class News:
    """Something that happened in one scenario."""

    scenario: str
    seed: int
    verdict: str | None
    """None: it has been started."""
    reason: str | None
    ds: float | None


@dataclass(frozen=True, slots=True)
class Standing:
    """How a submission stands, as its visitor may know it."""

    submission: schemas.Submission
    own: bool
    unfinished: bool
    done: int | None
    """Scenarios with a result; None where they are hidden."""
    total: int | None
    news: tuple[News, ...]

    @property
    def percent(self) -> int:
        """Of the scenarios."""
        return 100 * self.done // self.total if self.done and self.total else 0

    @property
    def said(self) -> str:
        """For screen readers: changes seldom."""
        state = self.submission.state
        if not self.unfinished:
            return f"this submission is {state}"
        return f"{state}, {self._step(self.done)} percent driven"

    def is_news(self, seen: int) -> bool:
        """Whether screen readers have not been told when so many scenarios were driven."""
        return not self.unfinished or self._step(self.done) != self._step(seen)

    def _step(self, done: int | None) -> int:
        return 100 * (done or 0) // (self.total or 1) // SAID_STEP * SAID_STEP


@router.get("/submissions/{submission}")
def show(
    request: Request,
    submission: schemas.Id,
    visitor: MaybeVisitor,
    using: ToolsOf,
    verdict: Which = "",
    sort: Order = "scenario",
) -> Response:
    """The page. `verdict` and `sort`: of the table of scenarios."""
    caller = visitor.caller if visitor else None
    stands = standing(using, caller, submission)
    rows = _scenarios(using, caller, submission)
    chosen = _sorted([row for row in rows or () if not verdict or verdict in (row.verdict, row.state)], sort)
    context: dict[str, Any] = {
        "rows": rows,
        "chosen": chosen,
        "verdict": verdict,
        "sort": sort,
        "verdicts": sorted({row.verdict or row.state for row in rows or ()}),
        "latency": histogram(row.usage for row in rows or ()),
        "used": _used(rows or ()),
    }
    return page(request, "submission.html", stands=stands, words=explanations, **context)


@router.get("/submissions/{submission}/progress")
def progress(submission: schemas.Id, visitor: MaybeVisitor, using: ToolsOf, seen: Seen = 0) -> Response:
    """How it stands, as a piece of its page. `seen`: how many scenarios were driven when it was last asked."""
    stands = standing(using, visitor.caller if visitor else None, submission)
    text = render("submission_live.html", stands=stands, words=explanations, visitor=visitor, seen=seen)
    event = "finished" if not stands.unfinished else "driven" if stands.done not in (None, seen) else ""
    headers = headers_of(True) | ({"HX-Trigger": event} if event else {})
    return Response(text, headers=headers, media_type="text/html")


@router.post("/submissions/{submission}/cancel")
def cancel(submission: schemas.Id, visitor: SomeVisitor, using: ToolsOf, at_us: Now) -> Response:
    """Stops it."""
    submissions.cancel_submission(submission, visitor.caller, using, at_us)
    return _back(submission)


@router.post("/submissions/{submission}/shown")
def choose(
    submission: schemas.Id, visitor: SomeVisitor, using: ToolsOf, at_us: Now, shown: Annotated[bool, Form()]
) -> Response:
    """Whether it may stand on the leaderboard."""
    submissions.choose_submission(submission, schemas.Show(shown=shown), visitor.caller, using, at_us)
    return _back(submission)


@router.post("/submissions/{submission}/disqualify")
def disqualify(
    submission: schemas.Id,
    visitor: AdminVisitor,
    using: ToolsOf,
    at_us: Now,
    reason: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """With a reason, which is shown."""
    why = schemas.Reason(reason=checked_text(reason, "reason", 500))
    submissions.disqualify_submission(submission, why, visitor.caller, using, at_us)
    return _back(submission)


@router.post("/submissions/{submission}/rerun")
def rerun(submission: schemas.Id, visitor: AdminVisitor, using: ToolsOf, at_us: Now) -> Response:
    """Once more, as a submission of its own."""
    return _back(submissions.rerun_submission(submission, visitor.caller, using, at_us).id)


def standing(using: Tools, caller: Caller | None, submission: str) -> Standing:
    """How it stands. Raises NotFound."""
    with using.store.read() as session:
        found = submission_views.found(session, caller, submission)
        shown = submission_views.shown(session, caller, found)
        phase = submission_views.phase_of(session, found)
        latest = select(tables.Event).where(tables.Event.submission == submission, tables.Event.kind != "state")
        own = submission_views.may_see_all(caller, found)
        events = session.scalars(latest.order_by(tables.Event.id.desc()).limit(NEWS)).all() if own else []
        told = [submission_views.event(phase, event.kind, event.data) for event in events]
    counts = shown.progress
    return Standing(
        submission=shown,
        own=own,
        unfinished=shown.state in UNFINISHED,
        done=counts.get(JobState.DONE, 0) if counts is not None else None,
        total=sum(counts.values()) if counts is not None else None,
        news=tuple(_news(data) for data in told if data is not None),
    )


def _news(data: Any) -> News:
    return News(data["scenario"], data["seed"], data.get("verdict"), data.get("reason"), data.get("ds"))


def _scenarios(using: Tools, caller: Caller | None, submission: str) -> list[schemas.Scenario] | None:
    """None where they are hidden."""
    try:
        return results.list_scenarios(submission, caller, using).items
    except Hidden:
        return None


def _sorted(rows: list[schemas.Scenario], order: str) -> list[schemas.Scenario]:
    """By name, or with what wants a look first: the worst figures, the most used."""
    if order in ("ds", "rc", "ip"):
        return sorted(rows, key=lambda row: -1.0 if getattr(row, order) is None else getattr(row, order))
    names = {"latency": "latency_p99_ms", "memory": "peak_memory_bytes", "cpu": "cpu_s"}
    if order in names:
        return sorted(rows, key=lambda row: -((row.usage or {}).get(names[order]) or 0.0))
    return rows


def _used(rows: Any) -> dict[str, float | None]:
    """By all scenarios together."""
    usages = [row.usage for row in rows if row.usage]
    return {
        "memory": max((usage.get("peak_memory_bytes") or 0 for usage in usages), default=None),
        "cpu": sum(usage.get("cpu_s") or 0.0 for usage in usages) if usages else None,
    }


def _back(submission: str) -> Response:
    return RedirectResponse(f"/submissions/{submission}", 303)
