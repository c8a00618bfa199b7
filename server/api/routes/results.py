"""Results, recordings and logs of single scenarios: of public phases; for admins of hidden ones, too."""

from collections.abc import Collection, Mapping
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Response
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
from server.store.overviews import SCORES

router = APIRouter(tags=["results"])
REPLAY_S = 60.0
_SANDBOX_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": "sandbox allow-scripts allow-downloads",
}
"""Files with content of agents get an opaque origin, so that their scripts cannot use the visitor's cookies."""
_SCENARIO_PATH = "/submissions/{submission}/scenarios/{scenario}/{seed}"


@router.get(
    "/submissions/{submission}/scenarios",
    response_model=schemas.ScenariosOut,
    responses=document_problems(401, 403, 404, 422),
)
async def show_scenarios(submission: schemas.Id, caller: OptionalCaller, services: ServicesDep) -> Response:
    """Return results, verdicts and resource usage, by scenario and seed."""
    return await services.run_large_read(lambda: _scenarios_response(submission, caller, services))


def _scenarios_response(submission: str, caller: Caller | None, services: Services) -> Response:
    """Return the list as a response; serialised here, because in the event loop it would delay all requests."""
    content = list_scenarios(submission, caller, services).model_dump_json()
    return Response(content, media_type="application/json")


def list_scenarios(submission: str, caller: Caller | None, services: Services) -> schemas.ScenariosOut:
    """Return the scenarios of a submission; it reads overviews only, never results. Takes up to a few 0.1 s."""
    with services.store.read() as session:
        own = submission_views.may_see_all(caller, _find_disclosed(session, caller, submission))
        admin = caller is not None and caller.is_admin
        columns = _ROW_COLUMNS if admin else _ROW_COLUMNS[:-1]
        found = session.execute(
            select(*columns, tables.JobOverviewRow.data)
            .outerjoin(tables.JobOverviewRow, tables.JobOverviewRow.job == tables.JobRow.id)
            .where(tables.JobRow.submission == submission)
            .order_by(tables.JobRow.scenario, tables.JobRow.seed)
        ).all()
    folders = _list_folders(services.settings, submission, {row.seed for row in found})
    return schemas.ScenariosOut(items=[_to_scenario(row._mapping, own, folders[row.seed]) for row in found])


@router.get(
    f"{_SCENARIO_PATH}/recording",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"application/octet-stream": {}}}},
)
def fetch_recording(
    submission: schemas.Id,
    scenario: schemas.ScenarioId,
    seed: schemas.Seed,
    caller: OptionalCaller,
    services: ServicesDep,
) -> FileResponse:
    """Return the recorded episode in the format of `mdrive-sumo`."""
    with services.store.read() as session:
        _find_job(session, caller, submission, scenario, seed)
    path = _require_file(paths.recording_path(services.settings, submission, scenario, seed), "recording")
    return FileResponse(
        path, media_type="application/octet-stream", filename=f"{scenario}-{seed}.npz", headers=_SANDBOX_HEADERS
    )


@router.get(
    f"{_SCENARIO_PATH}/replay",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
def fetch_replay(
    submission: schemas.Id,
    scenario: schemas.ScenarioId,
    seed: schemas.Seed,
    caller: OptionalCaller,
    services: ServicesDep,
) -> FileResponse:
    """Return the page that `mdrive-sumo view` writes: one file that loads nothing else. The first time takes seconds.

    Where too many pages are being written, the response is 503 with Retry-After.
    """
    with services.store.read() as session:
        job = _find_job(session, caller, submission, scenario, seed)
        suite = submission_views.get_phase(session, _submission(session, submission)).suite
    page = paths.replay_path(services.settings, submission, scenario, seed)
    if not page.is_file():
        recording = _require_file(paths.recording_path(services.settings, submission, scenario, seed), "recording")
        _write_page(services, replay_page.ReplayRequest(suite, scenario, job.result or {}, recording, page))
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
    services: ServicesDep,
) -> FileResponse:
    """Return the end of the log of a CAV's agent (`all` for a joint agent); for its team and admins."""
    with services.store.read() as session:
        submission_views.find_own(session, caller, submission)
        _find_job(session, caller, submission, scenario, seed)
    path = _require_file(paths.log_path(services.settings, submission, scenario, seed, cav), "log")
    return FileResponse(path, media_type="text/plain; charset=utf-8", headers=_SANDBOX_HEADERS)


def _find_disclosed(session: Session, caller: Caller | None, submission_id: str) -> tables.SubmissionRow:
    """Return a submission whose scenarios the caller may see. Raises NotFound, HiddenScenariosError."""
    submission = submission_views.find_visible(session, caller, submission_id)
    if not submission_views.get_phase(session, submission).public and not (caller is not None and caller.is_admin):
        raise HiddenScenariosError
    return submission


def _find_job(session: Session, caller: Caller | None, submission: str, scenario: str, seed: int) -> tables.JobRow:
    """Return a job that the caller may see. Raises NotFound and HiddenScenariosError."""
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


def _write_page(services: Services, request: replay_page.ReplayRequest) -> None:
    services.replay_runner.call(REPLAY_S, replay_page.write_replay_page, request)


def _require_file(path: Path, what: str) -> Path:
    if not path.is_file():
        sentence = f"{what}: there is none: it was not written, or its retention period is over"
        raise ProblemError(HTTPStatus.NOT_FOUND, "not-found", sentence)
    return path


_ROW_COLUMNS = (
    *(tables.JobRow.scenario, tables.JobRow.seed, tables.JobRow.state, tables.JobRow.verdict, tables.JobRow.reason),
    tables.JobRow.failure,
)


def _list_folders(settings: ServerSettings, submission: str, seeds: Collection[int]) -> dict[int, frozenset[str]]:
    """Return the names of the files of a submission by seed: one listing instead of a look for each file."""
    found: dict[int, frozenset[str]] = {}
    for seed in seeds:
        with suppress(FileNotFoundError):
            folder = paths.recordings_folder(settings, submission, seed)
            found[seed] = frozenset(file.name for file in folder.iterdir())
    return {seed: found.get(seed, frozenset()) for seed in seeds}


def _to_scenario(row: Mapping[str, Any], own: bool, files: frozenset[str]) -> schemas.ScenarioOut:
    overview: dict[str, Any] = row["data"] or {}
    log_names = [ego["id"] for ego in overview.get("egos", ())] + [paths.JOINT_CAV]
    return schemas.ScenarioOut(
        scenario=row["scenario"],
        seed=row["seed"],
        state=JobState(row["state"]),
        verdict=row["verdict"],
        reason=row["reason"],
        egos=[schemas.EgoOut.model_validate(ego) for ego in overview["egos"]] if "egos" in overview else None,
        usage=overview.get("usage"),
        recording=paths.recording_name(row["scenario"]) in files,
        logs=[name for name in log_names if own and paths.log_name(row["scenario"], name) in files],
        failure=row.get("failure"),
        **{name: overview.get(name) for name in SCORES},
    )
