"""Teams that make themselves."""

from fastapi import APIRouter

from server.api import registration, schemas
from server.api.dependencies import Now, ToolsOf
from server.api.problems import documented
from server.api.routes.teams import team

router = APIRouter(tags=["teams and tokens"])


@router.post("/register", status_code=201, responses=documented(400, 403, 408, 413, 422, 429))
def register(new: schemas.NewTeam, using: ToolsOf, at_us: Now) -> schemas.Registered:
    """A new team and its token, which is in this answer and nowhere else; where everybody may make one."""
    made = registration.register(using.store, using.settings.registration, new.name, at_us)
    return schemas.Registered(team=team(made.team), token=made.token)
