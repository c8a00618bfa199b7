"""The page of a submission: live status, then the result, and actions."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, Query, Request, Response
from fastapi.responses import RedirectResponse
from sqlalchemy import select

from server.api import submission_views
from server.api.dependencies import Now, Services, ServicesDep
from server.api.problems import HiddenScenariosError
from server.api.routes import results, submissions
from server.api.schemas.parameters import Id
from server.api.schemas.scenarios import ScenarioOut
from server.api.schemas.submissions import ReasonIn, SubmissionOut
from server.api.schemas.teams import ShowIn
from server.api.submission_views import Caller
from server.enums import JobState
from server.errors import check_text
from server.store import tables
from server.store.quota import UNFINISHED
from server.web import explanations, scenario_outcome
from server.web.board_view import SCALAR_COLUMNS
from server.web.charts import make_latency_histogram
from server.web.templating import page_headers, render, render_page
from server.web.visitor import AdminVisitor, AnyVisitor, OptionalVisitor

router = APIRouter()
MAX_EVENTS = 12
"""Number of latest events on the page of an unfinished submission."""
ANNOUNCE_STEP = 10
"""Progress between two announcements to screen readers [%]."""
SortOrder = Literal["scenario", "ds", "rc", "ip", "latency", "memory", "cpu"]
VerdictFilter = Annotated[str, Query(max_length=20)]
SeenCount = Annotated[int, Query(ge=0, le=1_000_000)]


@dataclass(frozen=True, slots=True)
class ScenarioEvent:
    """A latest event of one scenario."""

    scenario: str
    seed: int
    verdict: str | None
    """Verdict on the scenario; None if it was only started."""
    reason: str | None
    ds: float | None


@dataclass(frozen=True, slots=True)
class SubmissionStatus:
    """Status of a submission, as far as the visitor may see it."""

    submission: SubmissionOut
    own: bool
    unfinished: bool
    done: int | None
    """Scenarios with a result; None if they are hidden."""
    total: int | None
    news: tuple[ScenarioEvent, ...]

    @property
    def percent(self) -> int:
        """Progress [%]."""
        return 100 * self.done // self.total if self.done and self.total else 0

    @property
    def announcement(self) -> str:
        """Text for screen readers, which changes in steps."""
        state = self.submission.state
        if not self.unfinished:
            return f"this submission is {state}"
        return f"{state}, {self._step(self.done)} percent finished"

    def needs_announcement(self, seen: int) -> bool:
        """Return whether the text has changed since `seen` scenarios were finished."""
        return not self.unfinished or self._step(self.done) != self._step(seen)

    def _step(self, done: int | None) -> int:
        return 100 * (done or 0) // (self.total or 1) // ANNOUNCE_STEP * ANNOUNCE_STEP


@router.get("/submissions/{submission}")
async def show(
    request: Request,
    submission: Id,
    visitor: OptionalVisitor,
    services: ServicesDep,
    verdict: VerdictFilter = "",
    sort: SortOrder = "scenario",
) -> Response:
    """Show the page; `verdict` and `sort` apply to the table of scenarios."""
    caller = visitor.caller if visitor else None
    return await services.run_large_read(lambda: _render_page(request, submission, caller, services, verdict, sort))


def _render_page(
    request: Request, submission: str, caller: Caller | None, services: Services, verdict: str, sort: SortOrder
) -> Response:
    status = read_status(services, caller, submission)
    rows = _list_scenarios(services, caller, submission)
    not_run = [row for row in rows or () if row.state == JobState.CANCELLED]
    rows = None if rows is None else [row for row in rows if row.state != JobState.CANCELLED]
    chosen = _sort_rows([row for row in rows or () if scenario_outcome.match_filter(row, verdict)], sort)
    context: dict[str, Any] = {
        "rows": rows,
        "not_run": len(not_run),
        "failures": sum(map(scenario_outcome.has_failure, rows or ())),
        "outcome": scenario_outcome,
        "chosen": chosen,
        "verdict": verdict,
        "sort": sort,
        "verdicts": sorted({row.verdict or row.state for row in rows or ()}),
        "latency": make_latency_histogram(row.usage for row in rows or ()),
        "used": _sum_usage(rows or ()),
        "scalars": SCALAR_COLUMNS,
    }
    return render_page(request, "submission.html", submission_status=status, explanations=explanations, **context)


@router.get("/submissions/{submission}/progress")
def progress(submission: Id, visitor: OptionalVisitor, services: ServicesDep, seen: SeenCount = 0) -> Response:
    """Return the live part of the page; `seen`: finished scenarios at the last request."""
    status = read_status(services, visitor.caller if visitor else None, submission)
    text = render(
        "submission_live.html", submission_status=status, explanations=explanations, visitor=visitor, seen=seen
    )
    event = "finished" if not status.unfinished else "driven" if status.done not in (None, seen) else ""
    headers = page_headers(True) | ({"HX-Trigger": event} if event else {})
    return Response(text, headers=headers, media_type="text/html")


@router.post("/submissions/{submission}/cancel")
def cancel(submission: Id, visitor: AnyVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Cancel the submission."""
    submissions.cancel_submission(submission, visitor.caller, services, at_us)
    return _redirect(submission)


@router.post("/submissions/{submission}/shown")
def choose(
    submission: Id, visitor: AnyVisitor, services: ServicesDep, at_us: Now, shown: Annotated[bool, Form()]
) -> Response:
    """Choose whether it may be on the leaderboard."""
    submissions.choose_submission(submission, ShowIn(shown=shown), visitor.caller, services, at_us)
    return _redirect(submission)


@router.post("/submissions/{submission}/disqualify")
def disqualify(
    submission: Id,
    visitor: AdminVisitor,
    services: ServicesDep,
    at_us: Now,
    reason: Annotated[str, Form(max_length=1000)] = "",
) -> Response:
    """Disqualify it with a public reason."""
    why = ReasonIn(reason=check_text(reason, "reason", 500))
    submissions.disqualify_submission(submission, why, visitor.caller, services, at_us)
    return _redirect(submission)


@router.post("/submissions/{submission}/rerun")
def rerun(submission: Id, visitor: AdminVisitor, services: ServicesDep, at_us: Now) -> Response:
    """Run it again as a new submission."""
    return _redirect(submissions.rerun_submission(submission, visitor.caller, services, at_us).id)


def read_status(services: Services, caller: Caller | None, submission: str) -> SubmissionStatus:
    """Return the status. Raises NotFound."""
    with services.store.read() as session:
        visible = submission_views.find_visible(session, caller, submission)
        shown = submission_views.to_submission(session, caller, visible)
        phase = submission_views.get_phase(session, visible)
        latest = select(tables.EventRow).where(
            tables.EventRow.submission == submission, tables.EventRow.kind != "state"
        )
        own = submission_views.may_see_all(caller, visible)
        events = session.scalars(latest.order_by(tables.EventRow.id.desc()).limit(MAX_EVENTS)).all() if own else []
        disclosed = [submission_views.visible_event(phase, event.kind, event.data) for event in events]
    counts = shown.progress
    return SubmissionStatus(
        submission=shown,
        own=own,
        unfinished=shown.state in UNFINISHED,
        done=counts.get(JobState.DONE, 0) if counts is not None else None,
        total=sum(counts.values()) if counts is not None else None,
        news=tuple(
            ScenarioEvent(data["scenario"], data["seed"], data.get("verdict"), data.get("reason"), data.get("ds"))
            for data in disclosed
            if data is not None
        ),
    )


def _list_scenarios(services: Services, caller: Caller | None, submission: str) -> list[ScenarioOut] | None:
    """Return the scenarios, None if they are hidden."""
    try:
        return results.list_scenarios(submission, caller, services).items
    except HiddenScenariosError:
        return None


def _sort_rows(rows: list[ScenarioOut], order: str) -> list[ScenarioOut]:
    """Sort by name, or with the worst figures or largest usage first."""
    if order in ("ds", "rc", "ip"):
        return sorted(rows, key=lambda row: -1.0 if getattr(row, order) is None else getattr(row, order))
    names = {"latency": "latency_p99_ms", "memory": "peak_memory_bytes", "cpu": "cpu_s"}
    if order in names:
        return sorted(rows, key=lambda row: -((row.usage or {}).get(names[order]) or 0.0))
    return rows


def _sum_usage(rows: Any) -> dict[str, float | str | None]:
    """Return peak memory and total CPU time of all scenarios, and the backends of their sandboxes."""
    usages = [row.usage for row in rows if row.usage]
    return {
        "memory": max((usage.get("peak_memory_bytes") or 0 for usage in usages), default=None),
        "cpu": sum(usage.get("cpu_s") or 0.0 for usage in usages) if usages else None,
        "backend": ", ".join(sorted({usage["backend"] for usage in usages if usage.get("backend")})),
    }


def _redirect(submission: str) -> Response:
    return RedirectResponse(f"/submissions/{submission}", 303)
