"""Teams and tokens: made by admins."""

from fastapi import APIRouter

from server.api import schemas
from server.api.dependencies import Admin, Now, Somebody, ToolsOf
from server.api.problems import documented
from server.api.schemas import moment
from server.enums import Scope
from server.store import tables, teams, tokens

router = APIRouter(tags=["teams and tokens"])


@router.get("/me", responses=documented(401))
def who_am_i(caller: Somebody, using: ToolsOf) -> schemas.Me:
    """Who holds this token: the way to try one."""
    if caller.team is None:
        return schemas.Me(scope=caller.scope, team=None)
    with using.store.read() as session:
        return schemas.Me(scope=caller.scope, team=team(teams.get(session, caller.team)))


@router.get("/teams", responses=documented(401, 403))
def list_teams(_caller: Admin, using: ToolsOf) -> schemas.Teams:
    """All teams by name."""
    with using.store.read() as session:
        return schemas.Teams(items=[team(each) for each in teams.every(session)])


@router.post("/teams", status_code=201, responses=documented(400, 401, 403, 408, 413, 422))
def create_team(new: schemas.NewTeam, caller: Admin, using: ToolsOf, at_us: Now) -> schemas.Team:
    """A new team."""
    with using.store.write() as session:
        return team(teams.create(session, new.name, at_us, caller.actor))


@router.put("/teams/{name}/hidden", responses=documented(400, 401, 403, 404, 408, 413, 422))
def hide_team(name: schemas.Name, wish: schemas.Hide, caller: Admin, using: ToolsOf, at_us: Now) -> schemas.Team:
    """Takes a team (name or id) off the leaderboards, or puts it back."""
    with using.store.write() as session:
        found = teams.get(session, name)
        teams.hide(session, found.id, wish.hidden, at_us, caller.actor)
    using.boards.forget()
    return team(found)


@router.get("/teams/{name}/tokens", responses=documented(401, 403, 404, 422))
def list_tokens(name: schemas.Name, _caller: Admin, using: ToolsOf) -> schemas.Tokens:
    """Tokens of a team (name or id), also those revoked."""
    with using.store.read() as session:
        found = teams.get(session, name)
        return schemas.Tokens(items=[_token(each) for each in tokens.every(session, found)])


@router.post("/tokens", status_code=201, responses=documented(400, 401, 403, 404, 408, 413, 422))
def issue_token(new: schemas.NewToken, caller: Admin, using: ToolsOf, at_us: Now) -> schemas.IssuedToken:
    """A new token. Its text is in this answer and nowhere else."""
    with using.store.write() as session:
        holder = teams.get(session, new.team) if new.team is not None else None
        return schemas.IssuedToken(token=tokens.issue(session, holder, new.scope, at_us, caller.actor))


@router.delete("/tokens/{token}", status_code=204, responses=documented(401, 403, 404, 422))
def revoke_token(token: schemas.Id, caller: Admin, using: ToolsOf, at_us: Now) -> None:
    """From now on nobody holds it."""
    with using.store.write() as session:
        tokens.revoke(session, token, at_us, caller.actor)


def team(found: tables.Team) -> schemas.Team:
    """As the API shows it."""
    return schemas.Team(id=found.id, name=found.name, created=moment(found.created_us), hidden=found.hidden)


def _token(found: tables.Token) -> schemas.Token:
    revoked = moment(found.revoked_us) if found.revoked_us is not None else None
    return schemas.Token(
        id=found.id, team=found.team, scope=Scope(found.scope), created=moment(found.created_us), revoked=revoked
    )
