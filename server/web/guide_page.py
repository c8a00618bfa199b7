"""The page "How to take part", with the phases and limits of this server."""

from fastapi import APIRouter, Request, Response

from server import environments
from server.api.dependencies import Now, ServicesDep
from server.api.routes.phases import list_phases
from server.tracks import TRACK_LABELS
from server.web import explanations
from server.web.templating import render_page
from server.web.visitor import OptionalVisitor

router = APIRouter()


@router.get("/how")
def show(request: Request, services: ServicesDep, at_us: Now, _visitor: OptionalVisitor) -> Response:
    """Show the page."""
    settings = services.settings
    found = list_phases(services, at_us).items
    is_open = [phase for phase in found if phase.open]
    return render_page(
        request,
        "how.html",
        address=str(request.base_url).rstrip("/"),
        phases=found,
        now_us=at_us,
        example=(is_open or found or [None])[0],
        limits=settings.limits,
        sandbox=settings.sandbox,
        registration=settings.registration,
        environments=environments.RECIPES.values(),
        built=environments.list_built(settings.environments),
        tracks=TRACK_LABELS,
        explanations=explanations,
    )
