"""Submissions: send, list, show, cancel, choose for the leaderboard, disqualify, run again."""

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request
from sqlalchemy import select, tuple_

from server import paths
from server.api import submission_views
from server.api.dependencies import AdminCaller, AnyCaller, Now, OptionalCaller, ServicesDep, TeamCaller
from server.api.problems import document_problems
from server.api.schemas.parameters import Id, PhaseId, TeamName
from server.api.schemas.submissions import ReasonIn, SubmissionOut, SubmissionsOut
from server.api.schemas.teams import ShowIn
from server.api.submission_service import receive_submission
from server.api.upload import FILE_FIELD
from server.enums import ChallengeTrack
from server.store import NotNow, phases, submissions, tables, teams

router = APIRouter(tags=["submissions"])
PAGE = 50
"""Submissions of one page of the list."""
_FORM: dict[str, Any] = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": ["phase", "track", "name", FILE_FIELD],
                "additionalProperties": False,
                "properties": {
                    "phase": {"type": "string", "minLength": 1, "maxLength": 40, "description": "Id of the phase."},
                    "track": {"type": "string", "enum": [track.value for track in ChallengeTrack]},
                    "name": {"type": "string", "minLength": 1, "maxLength": 80, "description": "Name of your method."},
                    FILE_FIELD: {"type": "string", "format": "binary", "description": "The zip file."},
                },
            }
        }
    },
}
IdempotencyKey = Annotated[
    str | None,
    Header(
        max_length=80, description="A repeated key returns the same submission, so a request can be sent twice safely."
    ),
]


@router.post(
    "/submissions",
    status_code=201,
    responses=document_problems(400, 401, 403, 404, 408, 409, 413, 415, 422, 429),
    openapi_extra={"requestBody": _FORM},
)
async def submit(
    request: Request, member: TeamCaller, services: ServicesDep, at_us: Now, idempotency_key: IdempotencyKey = None
) -> SubmissionOut:
    """Submit an archive. The response comes at once, the result later: follow the events.

    The same archive in the same phase and track returns the finished result and uses no quota.
    """
    return await receive_submission(request, services, member, idempotency_key, at_us)


@router.get("/submissions", responses=document_problems(401, 404, 422))
def list_submissions(
    caller: AnyCaller,
    services: ServicesDep,
    phase: PhaseId | None = None,
    team: Annotated[TeamName | None, Query(description="Name or id; for admins.")] = None,
    before: Annotated[Id | None, Query(description="`next` of the page before.")] = None,
) -> SubmissionsOut:
    """Return the submissions of the token's team, for admins of all teams; 50 per page."""
    wanted = select(tables.SubmissionRow).order_by(
        tables.SubmissionRow.created_us.desc(), tables.SubmissionRow.id.desc()
    )
    with services.store.read() as session:
        if not caller.is_admin:
            wanted = wanted.where(tables.SubmissionRow.team == (caller.team or ""))
        elif team is not None:
            wanted = wanted.where(tables.SubmissionRow.team == teams.get(session, team).id)
        if phase is not None:
            wanted = wanted.where(tables.SubmissionRow.phase == phase)
        if before is not None:
            last = submission_views.find_own(session, caller, before)
            place = tuple_(tables.SubmissionRow.created_us, tables.SubmissionRow.id)
            wanted = wanted.where(place < tuple_(last.created_us, last.id))
        page = session.scalars(wanted.limit(PAGE + 1)).all()
        items = [submission_views.to_submission(session, caller, each) for each in page[:PAGE]]
        return SubmissionsOut(items=items, next=page[PAGE - 1].id if len(page) > PAGE else None)


@router.get("/submissions/{submission}", responses=document_problems(401, 404, 422))
def show_submission(submission: Id, caller: OptionalCaller, services: ServicesDep) -> SubmissionOut:
    """Return a submission: in full for its team and admins; the result for everyone if it is on a leaderboard."""
    with services.store.read() as session:
        return submission_views.to_submission(
            session, caller, submission_views.find_visible(session, caller, submission)
        )


@router.post("/submissions/{submission}/cancel", responses=document_problems(401, 404, 409, 422))
def cancel_submission(submission: Id, caller: AnyCaller, services: ServicesDep, at_us: Now) -> SubmissionOut:
    """Cancel a submission. If nothing was driven yet, it counts against the daily quota only, not in total."""
    with services.store.write() as session:
        submission_views.find_own(session, caller, submission)
        submissions.cancel(session, submission, at_us, caller.actor)
        return submission_views.to_submission(session, caller, submissions.get(session, submission))


@router.put("/submissions/{submission}/shown", responses=document_problems(400, 401, 404, 408, 413, 422))
def choose_submission(
    submission: Id, wish: ShowIn, caller: AnyCaller, services: ServicesDep, at_us: Now
) -> SubmissionOut:
    """Choose whether it may be on the leaderboard, which shows the best such submission of each team."""
    with services.store.write() as session:
        submission_views.find_own(session, caller, submission)
        submissions.set_shown(session, submission, wish.shown, at_us, caller.actor)
        answer = submission_views.to_submission(session, caller, submissions.get(session, submission))
    services.leaderboards.invalidate()
    return answer


@router.post("/submissions/{submission}/disqualify", responses=document_problems(400, 401, 403, 404, 408, 413, 422))
def disqualify_submission(
    submission: Id, why: ReasonIn, caller: AdminCaller, services: ServicesDep, at_us: Now
) -> SubmissionOut:
    """Remove it from the leaderboard; its team sees the reason."""
    with services.store.write() as session:
        submissions.disqualify(session, submission, why.reason, at_us, caller.actor)
        answer = submission_views.to_submission(session, caller, submissions.get(session, submission))
    services.leaderboards.invalidate()
    return answer


@router.post("/submissions/{submission}/rerun", status_code=201, responses=document_problems(401, 403, 404, 409, 422))
def rerun_submission(submission: Id, caller: AdminCaller, services: ServicesDep, at_us: Now) -> SubmissionOut:
    """Evaluate the archive again as a new submission that counts nowhere until it is shown."""
    with services.store.read() as session:
        old = submissions.get(session, submission)
        phase = phases.get(session, old.phase)
    if not paths.archive_path(services.settings, old.archive_sha256).is_file():
        raise NotNow(f"submission {submission}: its archive has been deleted, so it cannot be run again")
    evaluator, jobs = services.suites.evaluator(phase, old.environment), services.suites.jobs(phase)
    with services.store.write() as session:
        again = submissions.rerun(session, submission, evaluator, jobs, at_us, caller.actor)
        return submission_views.to_submission(session, caller, again)
