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
from server.api.dependencies import AnyCaller, Caller, OptionalCaller, Services, ServicesDep
from server.api.problems import HiddenScenariosError, ProblemError, document_problems
from server.enums import JobState
from server.settings import ServerSettings
from server.store import NotFound, tables

router = APIRouter(tags=["results"])
REPLAY_S = 60.0
_SANDBOX_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": "sandbox allow-scripts allow-downloads",
}
"""What agents have a part in is no page of ours: it is shown without our origin, hence without anybody's cookies."""
_SCENARIO_PATH = "/submissions/{submission}/scenarios/{scenario}/{seed}"


@router.get("/submissions/{submission}/scenarios", responses=document_problems(401, 403, 404, 422))
def list_scenarios(submission: schemas.Id, caller: OptionalCaller, using: ServicesDep) -> schemas.ScenariosOut:
    """Results, verdicts and what the agents used, by scenario and seed."""
    with using.store.read() as session:
        own = submission_views.may_see_all(caller, _find_disclosed(session, caller, submission))
        jobs = select(tables.JobRow).where(tables.JobRow.submission == submission)
        found = session.scalars(jobs.order_by(tables.JobRow.scenario, tables.JobRow.seed)).all()
        admin = caller is not None and caller.is_admin
        return schemas.ScenariosOut(items=[_to_scenario(using.settings, job, own, admin) for job in found])


@router.get(
    f"{_SCENARIO_PATH}/recording",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"application/octet-stream": {}}}},
)
def fetch_recording(
    submission: schemas.Id, scenario: schemas.ScenarioId, seed: schemas.Seed, caller: OptionalCaller, using: ServicesDep
) -> FileResponse:
    """The episode, as `mdrive-sumo` writes and reads it."""
    with using.store.read() as session:
        _find_job(session, caller, submission, scenario, seed)
    path = _require_file(paths.recording_path(using.settings, submission, scenario, seed), "recording")
    return FileResponse(
        path, media_type="application/octet-stream", filename=f"{scenario}-{seed}.npz", headers=_SANDBOX_HEADERS
    )


@router.get(
    f"{_SCENARIO_PATH}/replay",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
def fetch_replay(
    submission: schemas.Id, scenario: schemas.ScenarioId, seed: schemas.Seed, caller: OptionalCaller, using: ServicesDep
) -> FileResponse:
    """The page that `mdrive-sumo view` makes: one file that reaches no network. The first time takes some seconds.

    Few at a time wait for pages to be made; the others are asked to come back.
    """
    with using.store.read() as session:
        job = _find_job(session, caller, submission, scenario, seed)
        suite = submission_views.get_phase(session, _submission(session, submission)).suite
    page = paths.replay_path(using.settings, submission, scenario, seed)
    if not page.is_file():
        recording = _require_file(paths.recording_path(using.settings, submission, scenario, seed), "recording")
        _made(using, replay_page.ReplayRequest(suite, scenario, job.result or {}, recording, page))
    return FileResponse(page, media_type="text/html", headers=_SANDBOX_HEADERS)


@router.get(
    f"{_SCENARIO_PATH}/logs/{{cav}}",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422)
    | {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def fetch_log(
    submission: schemas.Id,
    scenario: schemas.ScenarioId,
    seed: schemas.Seed,
    cav: schemas.ScenarioId,
    caller: AnyCaller,
    using: ServicesDep,
) -> FileResponse:
    """The end of what the agent of a CAV wrote (`all` for a joint agent); for its team and admins."""
    with using.store.read() as session:
        submission_views.find_own(session, caller, submission)
        _find_job(session, caller, submission, scenario, seed)
    path = _require_file(paths.log_path(using.settings, submission, scenario, seed, cav), "log")
    return FileResponse(path, media_type="text/plain; charset=utf-8", headers=_SANDBOX_HEADERS)


def _find_disclosed(session: Session, caller: Caller | None, submission_id: str) -> tables.SubmissionRow:
    """One of whose scenarios the caller may see. Raises NotFound and Hidden."""
    submission = submission_views.find_visible(session, caller, submission_id)
    if not submission_views.get_phase(session, submission).public and not (caller is not None and caller.is_admin):
        raise HiddenScenariosError
    return submission


def _find_job(session: Session, caller: Caller | None, submission: str, scenario: str, seed: int) -> tables.JobRow:
    """One result that the caller may see. Raises NotFound and Hidden."""
    _find_disclosed(session, caller, submission)
    wanted = select(tables.JobRow).where(
        tables.JobRow.submission == submission, tables.JobRow.scenario == scenario, tables.JobRow.seed == seed
    )
    if (job := session.scalar(wanted)) is None:
        raise NotFound(f"scenario: this submission has no {scenario!r} with seed {seed}")
    return job


def _submission(session: Session, submission_id: str) -> tables.SubmissionRow:
    found = session.get(tables.SubmissionRow, submission_id)
    assert found is not None
    return found


def _made(using: Services, order: replay_page.ReplayRequest) -> None:
    using.painter.call(REPLAY_S, replay_page.write_replay_page, order)


def _require_file(path: Path, what: str) -> Path:
    if not path.is_file():
        sentence = f"{what}: there is none: it was not made, or its time is over"
        raise ProblemError(HTTPStatus.NOT_FOUND, "not-found", sentence)
    return path


def _to_scenario(settings: ServerSettings, job: tables.JobRow, own: bool, admin: bool) -> schemas.ScenarioOut:
    result: dict[str, Any] = job.result or {}
    names = [ego["id"] for ego in result.get("egos", ())] + [paths.JOINT_CAV]
    place = (settings, job.submission, job.scenario, job.seed)
    return schemas.ScenarioOut(
        scenario=job.scenario,
        seed=job.seed,
        state=JobState(job.state),
        verdict=job.verdict,
        reason=job.reason,
        egos=[schemas.EgoOut.model_validate(ego) for ego in result["egos"]] if "egos" in result else None,
        usage=job.usage,
        recording=paths.recording_path(*place).is_file(),
        logs=[name for name in names if own and paths.log_path(*place, name).is_file()],
        failure=job.failure if admin else None,
        **{name: result.get(name) for name in ("bucket", "category", "ds", "sr", "rc", "ip")},
    )
