"""Results, recordings and logs of single scenarios: of public phases; for admins of hidden ones, too."""

import json
from bisect import bisect_left
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from itertools import islice, takewhile
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response
from fastapi.responses import FileResponse
from sqlalchemy import ColumnElement, RowMapping, Text, cast, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from server import paths
from server.api import child_calls, submission_views
from server.api.csv_format import csv_headers, to_csv
from server.api.dependencies import AnyCaller, Caller, OptionalCaller, Services, ServicesDep
from server.api.problems import HiddenScenariosError, ProblemError, document_problems
from server.api.schemas.parameters import Id, ScenarioId, Seed
from server.api.schemas.scenarios import EgoOut, ScenarioOut, ScenariosOut
from server.settings import ServerSettings
from server.store import NotFound, submissions, tables
from server.store.overviews import EMPTY_OVERVIEW

router = APIRouter(tags=["results"])
REPLAY_S = 60.0
"""Time limit of writing a replay page, waiting for its turn included [s]."""
_SANDBOX_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": "sandbox allow-scripts allow-downloads",
}
"""Files with content of agents get an opaque origin, so that their scripts cannot use the visitor's cookies."""
SCENARIO_PATH = "/submissions/{submission}/scenarios/{scenario}/{seed}"


@dataclass(frozen=True, slots=True)
class ScenarioPlace:
    """What `SCENARIO_PATH` names."""

    submission: Id
    scenario: ScenarioId
    seed: Seed


@dataclass(frozen=True, slots=True)
class LogPlace(ScenarioPlace):
    """The log of an agent in a scenario."""

    cav: ScenarioId
    """The CAV whose agent wrote the log; `all` for a joint agent."""


Place = Annotated[ScenarioPlace, Depends()]
PlaceOfLog = Annotated[LogPlace, Depends()]


@router.get(
    "/submissions/{submission}/scenarios",
    response_model=ScenariosOut,
    responses=document_problems(401, 403, 404, 422),
)
async def show_scenarios(submission: Id, caller: OptionalCaller, services: ServicesDep) -> Response:
    """Return results, verdicts and resource usage, by scenario and seed."""
    return await services.run_large_read(lambda: _scenarios_response(submission, caller, services))


def _scenarios_response(submission: str, caller: Caller | None, services: Services) -> Response:
    """Return a `ScenariosOut`, joined from the stored texts of the overviews: parsing them takes ten times as long."""
    data = cast(tables.JobOverviewRow.data, Text)
    rows, own = _read_rows(submission, caller, services, data)
    files = _list_files(services.settings, submission, {row["seed"] for row in rows})
    items: list[str] = []
    for row in rows:
        fixed = json.dumps(_describe_row(row, own, files[row["seed"]]))
        overview: str = row["data"] or _NO_OVERVIEW
        items.append(f"{fixed[:-1]},{overview[1:]}")
    return Response(f'{{"items":[{",".join(items)}]}}', media_type="application/json")


@router.get(
    "/submissions/{submission}/scenarios.csv",
    response_class=Response,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"text/csv": {"schema": {"type": "string"}}}}},
)
async def download_scenarios(submission: Id, caller: OptionalCaller, services: ServicesDep) -> Response:
    """Return the results by scenario and seed as CSV, one line each."""
    scenarios = await services.run_large_read(lambda: list_scenarios(submission, caller, services))
    return Response(
        _format_csv(scenarios.items), media_type="text/csv", headers=csv_headers(f"submission-{submission}")
    )


def list_scenarios(submission: str, caller: Caller | None, services: Services) -> ScenariosOut:
    """Return the scenarios of a submission for a page; it reads overviews only, never results."""
    rows, own = _read_rows(submission, caller, services, tables.JobOverviewRow.data)
    files = _list_files(services.settings, submission, {row["seed"] for row in rows})
    items: list[ScenarioOut] = []
    for row in rows:  # stored by us, so that nothing needs to be validated
        overview: dict[str, Any] = row["data"] or EMPTY_OVERVIEW
        egos = overview["egos"]
        listed = None if egos is None else [EgoOut.model_construct(None, **ego) for ego in egos]
        fields: dict[str, Any] = _describe_row(row, own, files[row["seed"]]) | overview | {"egos": listed}
        items.append(ScenarioOut.model_construct(None, **fields))
    return ScenariosOut.model_construct(items=items)


@router.get(
    f"{SCENARIO_PATH}/recording",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"application/octet-stream": {}}}},
)
def fetch_recording(place: Place, caller: OptionalCaller, services: ServicesDep) -> FileResponse:
    """Return the recorded episode in the format of `mdrive-sumo`."""
    with services.store.read() as session:
        _find_job(session, caller, place)
    name = f"{place.scenario}-{place.seed}.npz"
    path = _find_recording(services.settings, place)
    return FileResponse(path, media_type="application/octet-stream", filename=name, headers=_SANDBOX_HEADERS)


@router.get(
    f"{SCENARIO_PATH}/replay",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422) | {200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
def fetch_replay(place: Place, caller: OptionalCaller, services: ServicesDep) -> FileResponse:
    """Return the page that `mdrive-sumo view` writes: one file that loads nothing else. The first time takes seconds.

    Where too many pages are being written, the response is 503 with Retry-After.
    """
    with services.store.read() as session:
        job = _find_job(session, caller, place)
        suite = submission_views.get_phase(session, submissions.get(session, place.submission)).suite
    page = paths.replay_path(services.settings, place.submission, place.scenario, place.seed)
    if not page.is_file():
        recording = _find_recording(services.settings, place)
        request = child_calls.ReplayRequest(suite, place.scenario, job.result or {}, recording, page)
        services.replay_runner.call(REPLAY_S, child_calls.write_replay_page, request)
    return FileResponse(page, media_type="text/html", headers=_SANDBOX_HEADERS)


@router.get(
    f"{SCENARIO_PATH}/logs/{{cav}}",
    response_class=FileResponse,
    responses=document_problems(401, 403, 404, 422)
    | {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
def fetch_log(place: PlaceOfLog, caller: AnyCaller, services: ServicesDep) -> FileResponse:
    """Return the end of the log of a CAV's agent (`all` for a joint agent); for its team and admins."""
    with services.store.read() as session:
        submission_views.find_own(session, caller, place.submission)
        _find_job(session, caller, place)
    path = paths.log_path(services.settings, place.submission, place.scenario, place.seed, place.cav)
    _require_file(path, "log")
    return FileResponse(path, media_type="text/plain; charset=utf-8", headers=_SANDBOX_HEADERS)


def _format_csv(rows: Sequence[ScenarioOut]) -> str:
    fields = ("scenario", "seed", "bucket", "category", "state", "verdict", "reason")
    scores = ("ds", "sr", "efficient_sr", "time_ratio", "rc", "ip")
    usage = ("latency_p99_ms", "peak_memory_bytes", "cpu_s")
    return to_csv(
        (*fields, *scores, "outcomes", "infractions", *usage),
        (
            (
                *(getattr(row, name) for name in (*fields, *scores)),
                " ".join(f"{ego.id}:{ego.outcome}" for ego in row.egos or ()),
                sum(len(ego.infractions) + ego.infractions_left_out for ego in row.egos or ()),
                *((row.usage or {}).get(name) for name in usage),
            )
            for row in rows
        ),
    )


def _find_disclosed(session: Session, caller: Caller | None, submission_id: str) -> tables.SubmissionRow:
    """Return a submission whose scenarios the caller may see. Raises NotFound, HiddenScenariosError."""
    submission = submission_views.find_visible(session, caller, submission_id)
    if not submission_views.may_see_scenarios(caller, submission_views.get_phase(session, submission)):
        raise HiddenScenariosError
    return submission


def _find_job(session: Session, caller: Caller | None, place: ScenarioPlace) -> tables.JobRow:
    """Return a job that the caller may see. Raises NotFound and HiddenScenariosError."""
    _find_disclosed(session, caller, place.submission)
    row = tables.JobRow
    wanted = select(row).where(row.is_of(place.submission), row.scenario == place.scenario, row.seed == place.seed)
    if (job := session.scalar(wanted)) is None:
        raise NotFound(f"scenario: this submission has no {place.scenario!r} with seed {place.seed}")
    return job


def _find_recording(settings: ServerSettings, place: ScenarioPlace) -> Path:
    path = paths.recording_path(settings, place.submission, place.scenario, place.seed)
    return _require_file(path, "recording")


def _require_file(path: Path, what: str) -> Path:
    if not path.is_file():
        sentence = f"{what}: there is none: it was not written, or its retention period is over"
        raise ProblemError(HTTPStatus.NOT_FOUND, "not-found", sentence)
    return path


_ROW_COLUMNS = (
    *(tables.JobRow.scenario, tables.JobRow.seed, tables.JobRow.state, tables.JobRow.verdict, tables.JobRow.reason),
    tables.JobRow.failure,
)
_NO_OVERVIEW = json.dumps(EMPTY_OVERVIEW)


def _read_rows(
    submission: str, caller: Caller | None, services: Services, data: ColumnElement[Any] | InstrumentedAttribute[Any]
) -> tuple[Sequence[RowMapping], bool]:
    """Return the jobs with their overviews as `data`, and whether the caller may see files of its own."""
    with services.store.read() as session:
        own = submission_views.may_see_all(caller, _find_disclosed(session, caller, submission))
        admin = caller is not None and caller.is_admin
        columns = _ROW_COLUMNS if admin else _ROW_COLUMNS[:-1]  # behind the long columns of a row
        rows = session.execute(
            select(*columns, data.label("data"))
            .outerjoin(tables.JobOverviewRow, tables.JobOverviewRow.job == tables.JobRow.id)
            .where(tables.JobRow.is_of(submission))
            .order_by(tables.JobRow.scenario, tables.JobRow.seed)
        )
        return rows.mappings().all(), own


def _list_files(settings: ServerSettings, submission: str, seeds: Collection[int]) -> dict[int, Sequence[str]]:
    """Return the sorted names of the files of a submission by seed: one listing instead of a look for each file."""
    files: dict[int, Sequence[str]] = dict.fromkeys(seeds, ())
    for seed in seeds:
        with suppress(FileNotFoundError):
            files[seed] = sorted(file.name for file in paths.recordings_folder(settings, submission, seed).iterdir())
    return files


def _describe_row(row: RowMapping, own: bool, files: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a `ScenarioOut` that are not in its overview."""
    scenario: str = row["scenario"]
    start = bisect_left(files, f"{scenario}.")
    mine = list(takewhile(lambda name: name.startswith(f"{scenario}."), islice(files, start, None)))
    logs = [name.removeprefix(f"{scenario}.").removesuffix(".log") for name in mine if name.endswith(".log")]
    return {
        **{name: row[name] for name in ("scenario", "seed", "state", "verdict", "reason")},
        "recording": paths.recording_name(scenario) in mine,
        "logs": logs if own else [],
        "failure": row.get("failure"),
    }
