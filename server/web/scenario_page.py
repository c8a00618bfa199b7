"""The page of one scenario: replay, outcome of each car, files. The API decides on access."""

from fastapi import APIRouter, Request, Response

from server.api.dependencies import Services, ServicesDep
from server.api.routes import results, submissions
from server.api.routes.results import SCENARIO_PATH, Place, PlaceOfLog, ScenarioPlace
from server.api.submission_views import Caller
from server.store import NotFound
from server.web import explanations, scenario_outcome
from server.web.charts import make_latency_histogram
from server.web.templating import render_page
from server.web.visitor import AnyVisitor, OptionalVisitor, Visitor

router = APIRouter()


@router.get(SCENARIO_PATH)
async def show(request: Request, place: Place, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Show the page, with the replay in a frame of an opaque origin."""
    caller = _get_caller(visitor)
    return await services.run_large_read(lambda: _render_page(request, place, caller, services))


def _render_page(request: Request, place: ScenarioPlace, caller: Caller | None, services: Services) -> Response:
    rows = results.list_scenarios(place.submission, caller, services).items
    index = next((i for i, row in enumerate(rows) if (row.scenario, row.seed) == (place.scenario, place.seed)), None)
    if index is None:
        raise NotFound(f"scenario: this submission has no {place.scenario!r} with seed {place.seed}")
    return render_page(
        request,
        "replay.html",
        it=submissions.show_submission(place.submission, caller, services),
        row=rows[index],
        before=rows[index - 1] if index else None,
        after=rows[index + 1] if index + 1 < len(rows) else None,
        outcome=scenario_outcome,
        latency=make_latency_histogram([rows[index].usage]),
        explanations=explanations,
    )


@router.get(f"{SCENARIO_PATH}/replay")
def replay(place: Place, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Return the replay for the frame."""
    return _with_revalidation(results.fetch_replay(place, _get_caller(visitor), services))


@router.get(f"{SCENARIO_PATH}/recording")
def recording(place: Place, visitor: OptionalVisitor, services: ServicesDep) -> Response:
    """Return the recorded episode."""
    return _with_revalidation(results.fetch_recording(place, _get_caller(visitor), services))


@router.get(f"{SCENARIO_PATH}/logs/{{cav}}")
def log(place: PlaceOfLog, visitor: AnyVisitor, services: ServicesDep) -> Response:
    """Return the log of an agent."""
    return _with_revalidation(results.fetch_log(place, visitor.caller, services))


def _get_caller(visitor: Visitor | None) -> Caller | None:
    return visitor.caller if visitor is not None else None


def _with_revalidation(file: Response) -> Response:
    """Make the browser revalidate the file each time, because access can change."""
    file.headers["Cache-Control"] = "private, no-cache"
    file.headers["Vary"] = "Cookie"
    return file
