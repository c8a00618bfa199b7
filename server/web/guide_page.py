"""The page "How to take part", with the phases and limits of this server."""

from fastapi import APIRouter, Request, Response
from fastapi.responses import FileResponse

from mdrive_sumo import __version__
from server import environments
from server.api.dependencies import Now, ServicesDep
from server.api.routes.phases import find_default_phase, list_phases
from server.store import NotFound
from server.tracks import TRACK_LABELS
from server.web import explanations
from server.web.templating import render_page
from server.web.visitor import OptionalVisitor

router = APIRouter()


@router.get("/how")
def show(request: Request, services: ServicesDep, at_us: Now, _visitor: OptionalVisitor) -> Response:
    """Show the page."""
    settings = services.settings
    listed = list_phases(services, at_us).items
    return render_page(
        request,
        "how.html",
        address=str(request.base_url).rstrip("/"),
        phases=listed,
        now_us=at_us,
        example=find_default_phase(listed),
        limits=settings.limits,
        sandbox=settings.sandbox,
        registration=settings.registration,
        environments=environments.RECIPES.values(),
        built=environments.list_built(settings.environments),
        tracks=TRACK_LABELS,
        explanations=explanations,
        wheel=settings.wheel.name if settings.wheel else "",
        version=__version__,
    )


@router.get("/download/{name}")
def download_wheel(name: str, services: ServicesDep) -> Response:
    """Return the wheel of this server's version, which participants install."""
    wheel = services.settings.wheel
    if wheel is None or name != wheel.name or not wheel.is_file():
        raise NotFound(f"download: there is no {name!r:.80}")
    return FileResponse(wheel, media_type="application/zip", filename=wheel.name)
