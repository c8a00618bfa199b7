"""The page of one scenario: replay, outcome of each car, files. The API decides on access."""

from fastapi import APIRouter, Request, Response

from server.api.dependencies import Services, ServicesDep
from server.api.routes import results, submissions
from server.api.schemas.parameters import Id, ScenarioId, Seed
from server.api.submission_views import Caller
from server.store import NotFound
from server.web import explanations, scenario_outcome
from server.web.charts import make_latency_histogram
from server.web.templating import render_page
from server.web.visitor import AnyVisitor, OptionalVisitor, Visitor

router = APIRouter()
_SCENARIO_PATH = "/submissions/{submission}/scenarios/{scenario}/{seed}"


@router.get(_SCENARIO_PATH)
async def show(
    request: Request,
    submission: Id,
    scenario: ScenarioId,
    seed: Seed,
    visitor: OptionalVisitor,
    services: ServicesDep,
) -> Response:
    """Show the page, with the replay in a frame of an opaque origin."""
    caller = _get_caller(visitor)
    return await services.run_large_read(lambda: _render_page(request, submission, scenario, seed, caller, services))


def _render_page(
    request: Request, submission: str, scenario: str, seed: int, caller: Caller | None, services: Services
) -> Response:
    rows = results.list_scenarios(submission, caller, services).items
    places = [i for i, row in enumerate(rows) if (row.scenario, row.seed) == (scenario, seed)]
    if not places:
        raise NotFound(f"scenario: this submission has no {scenario!r} with seed {seed}")
    at = places[0]
    return render_page(
        request,
        "replay.html",
        it=submissions.show_submission(submission, caller, services),
        row=rows[at],
        before=rows[at - 1] if at else None,
        after=rows[at + 1] if at + 1 < len(rows) else None,
        outcome=scenario_outcome,
        latency=make_latency_histogram([rows[at].usage]),
        explanations=explanations,
    )


@router.get(f"{_SCENARIO_PATH}/replay")
def replay(
    submission: Id,
    scenario: ScenarioId,
    seed: Seed,
    visitor: OptionalVisitor,
    services: ServicesDep,
) -> Response:
    """Return the replay for the frame."""
    return _with_revalidation(results.fetch_replay(submission, scenario, seed, _get_caller(visitor), services))


@router.get(f"{_SCENARIO_PATH}/recording")
def recording(
    submission: Id,
    scenario: ScenarioId,
    seed: Seed,
    visitor: OptionalVisitor,
    services: ServicesDep,
) -> Response:
    """Return the recorded episode."""
    return _with_revalidation(results.fetch_recording(submission, scenario, seed, _get_caller(visitor), services))


@router.get(f"{_SCENARIO_PATH}/logs/{{cav}}")
def log(
    submission: Id,
    scenario: ScenarioId,
    seed: Seed,
    cav: ScenarioId,
    visitor: AnyVisitor,
    services: ServicesDep,
) -> Response:
    """Return the log of an agent."""
    return _with_revalidation(results.fetch_log(submission, scenario, seed, cav, visitor.caller, services))


def _get_caller(visitor: Visitor | None) -> Caller | None:
    return visitor.caller if visitor is not None else None


def _with_revalidation(file: Response) -> Response:
    """Make the browser revalidate the file each time, because access can change."""
    file.headers["Cache-Control"] = "private, no-cache"
    file.headers["Vary"] = "Cookie"
    return file
