"""Results of single scenarios, with recordings and logs: of public phases only, but for admins."""

from http import HTTPStatus
from pathlib import Path
from typing import Any

from fastapi import APIRouter
from fastapi.responses import FileResponse
from sqlalchemy import select
from sqlalchemy.orm import Session

from server import paths
from server.api import replay_page, schemas, submission_views
from server.api.dependencies import Anyone, Caller, Somebody, Tools, ToolsOf
from server.api.problems import Hidden, ProblemError, documented
from server.enums import JobState
from server.settings import Settings
from server.store import NotFound, tables

router = APIRouter(tags=["results"])
REPLAY_S = 60.0
_APART = {"X-Content-Type-Options": "nosniff", "Content-Security-Policy": "sandbox allow-scripts allow-downloads"}
"""What agents have a part in is no page of ours: it is shown without our origin, hence without anybody's cookies."""
_ONE = "/submissions/{submission}/scenarios/{scenario}/{seed}"


@router.get("/submissions/{submission}/scenarios", responses=documented(401, 403, 404, 422))
def list_scenarios(submission: schemas.Id, caller: Anyone, using: ToolsOf) -> schemas.Scenarios:
    """Results, verdicts and what the agents used, by scenario and seed."""
    with using.store.read() as session:
        own = submission_views.may_see_all(caller, _open(session, caller, submission))
        jobs = select(tables.Job).where(tables.Job.submission == submission)
        found = session.scalars(jobs.order_by(tables.Job.scenario, tables.Job.seed)).all()
        admin = caller is not None and caller.is_admin
        return schemas.Scenarios(items=[_shown(using.settings, job, own, admin) for job in found])


@router.get(
    f"{_ONE}/recording",
    response_class=FileResponse,
    responses=documented(401, 403, 404, 422) | {200: {"content": {"application/octet-stream": {}}}},
)
def fetch_recording(
    submission: schemas.Id, scenario: schemas.ScenarioId, seed: schemas.Seed, caller: Anyone, using: ToolsOf
) -> FileResponse:
    """The episode, as `mdrive-sumo` writes and reads it."""
    with using.store.read() as session:
        _job(session, caller, submission, scenario, seed)
    path = _there(paths.recording(using.settings, submission, scenario, seed), "recording")
    return FileResponse(path, media_type="application/octet-stream", filename=f"{scenario}-{seed}.npz", headers=_APART)


@router.get(
    f"{_ONE}/replay",
    response_class=FileResponse,
    responses=documented(401, 403, 404, 422) | {200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
def fetch_replay(
    submission: schemas.Id, scenario: schemas.ScenarioId, seed: schemas.Seed, caller: Anyone, using: ToolsOf
) -> FileResponse:
    """The page that `mdrive-sumo view` makes: one file that reaches no network. The first time takes some seconds.

    Few at a time wait for pages to be made; the others are asked to come back.
    """
    with using.store.read() as session:
        job = _job(session, caller, submission, scenario, seed)
        suite = submission_views.phase_of(session, _submission(session, submission)).suite
    page = paths.replay(using.settings, submission, scenario, seed)
    if not page.is_file():
        recording = _there(paths.recording(using.settings, submission, scenario, seed), "recording")
        _made(using, replay_page.Order(suite, scenario, job.result or {}, recording, page))
    return FileResponse(page, media_type="text/html", headers=_APART)


@router.get(
    f"{_ONE}/logs/{{cav}}",
    response_class=FileResponse,
    responses=documented(401, 403, 404, 422) | {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def fetch_log(
    submission: schemas.Id,
    scenario: schemas.ScenarioId,
    seed: schemas.Seed,
    cav: schemas.ScenarioId,
    caller: Somebody,
    using: ToolsOf,
) -> FileResponse:
    """The end of what the agent of a CAV wrote (`all` for a joint agent); for its team and admins."""
    with using.store.read() as session:
        submission_views.own(session, caller, submission)
        _job(session, caller, submission, scenario, seed)
    path = _there(paths.log(using.settings, submission, scenario, seed, cav), "log")
    return FileResponse(path, media_type="text/plain; charset=utf-8", headers=_APART)


def _open(session: Session, caller: Caller | None, submission_id: str) -> tables.Submission:
    """One of whose scenarios the caller may see. Raises NotFound and Hidden."""
    submission = submission_views.found(session, caller, submission_id)
    if not submission_views.phase_of(session, submission).public and not (caller is not None and caller.is_admin):
        raise Hidden
    return submission


def _job(session: Session, caller: Caller | None, submission: str, scenario: str, seed: int) -> tables.Job:
    """One result that the caller may see. Raises NotFound and Hidden."""
    _open(session, caller, submission)
    wanted = select(tables.Job).where(
        tables.Job.submission == submission, tables.Job.scenario == scenario, tables.Job.seed == seed
    )
    if (job := session.scalar(wanted)) is None:
        raise NotFound(f"scenario: this submission has no {scenario!r} with seed {seed}")
    return job


def _submission(session: Session, submission_id: str) -> tables.Submission:
    found = session.get(tables.Submission, submission_id)
    assert found is not None
    return found


def _made(using: Tools, order: replay_page.Order) -> None:
    using.painter.call(REPLAY_S, replay_page.make, order)


def _there(path: Path, what: str) -> Path:
    if not path.is_file():
        sentence = f"{what}: there is none: it was not made, or its time is over"
        raise ProblemError(HTTPStatus.NOT_FOUND, "not-found", sentence)
    return path


def _shown(settings: Settings, job: tables.Job, own: bool, admin: bool) -> schemas.Scenario:
    result: dict[str, Any] = job.result or {}
    names = [ego["id"] for ego in result.get("egos", ())] + [paths.ALL]
    place = (settings, job.submission, job.scenario, job.seed)
    return schemas.Scenario(
        scenario=job.scenario,
        seed=job.seed,
        state=JobState(job.state),
        verdict=job.verdict,
        reason=job.reason,
        egos=[schemas.Ego.model_validate(ego) for ego in result["egos"]] if "egos" in result else None,
        usage=job.usage,
        recording=paths.recording(*place).is_file(),
        logs=[name for name in names if own and paths.log(*place, name).is_file()],
        failure=job.failure if admin else None,
        **{name: result.get(name) for name in ("bucket", "category", "ds", "sr", "rc", "ip")},
    )
