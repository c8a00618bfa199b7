"""Self-registration of teams."""

from fastapi import APIRouter

from server.api import registration
from server.api.dependencies import Now, ServicesDep
from server.api.problems import document_problems
from server.api.routes.teams import to_team
from server.api.schemas.teams import NewTeamIn, RegisteredOut

router = APIRouter(tags=["teams and tokens"])


@router.post("/register", status_code=201, responses=document_problems(400, 403, 408, 413, 422, 429))
def register(new: NewTeamIn, services: ServicesDep, at_us: Now) -> RegisteredOut:
    """Register a team where registration is open. Its token is in this response only."""
    made = registration.register(services.store, services.settings.registration, new.name, at_us)
    return RegisteredOut(team=to_team(made.team), token=made.token)
