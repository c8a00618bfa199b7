"""Self-registration of teams."""

from fastapi import APIRouter

from server.api import registration, schemas
from server.api.dependencies import Now, ServicesDep
from server.api.problems import document_problems
from server.api.routes.teams import to_team

router = APIRouter(tags=["teams and tokens"])


@router.post("/register", status_code=201, responses=document_problems(400, 403, 408, 413, 422, 429))
def register(new: schemas.NewTeamIn, services: ServicesDep, at_us: Now) -> schemas.RegisteredOut:
    """Register a team where registration is open. Its token is in this response only."""
    made = registration.register(services.store, services.settings.registration, new.name, at_us)
    return schemas.RegisteredOut(team=to_team(made.team), token=made.token)
