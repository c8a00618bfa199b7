"""Teams that make themselves."""

from fastapi import APIRouter

from server.api import registration, schemas
from server.api.dependencies import Now, ServicesDep
from server.api.problems import document_problems
from server.api.routes.teams import to_team

router = APIRouter(tags=["teams and tokens"])


@router.post("/register", status_code=201, responses=document_problems(400, 403, 408, 413, 422, 429))
def register(new: schemas.NewTeamIn, using: ServicesDep, at_us: Now) -> schemas.RegisteredOut:
    """A new team and its token, which is in this answer and nowhere else; where everybody may make one."""
    made = registration.register(using.store, using.settings.registration, new.name, at_us)
    return schemas.RegisteredOut(team=to_team(made.team), token=made.token)
