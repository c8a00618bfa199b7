"""Teams and tokens, managed by admins, and the self-registration of teams, where the settings allow it."""

from http import HTTPStatus
from typing import NamedTuple

from fastapi import APIRouter
from sqlalchemy import func, select

from server.api.dependencies import AdminCaller, AnyCaller, Now, ServicesDep
from server.api.problems import ProblemError, document_problems
from server.api.schemas.parameters import Id, TeamName, to_datetime
from server.api.schemas.teams import (
    HideIn,
    IssuedTokenOut,
    MeOut,
    NewTeamIn,
    NewTokenIn,
    RegisteredOut,
    TeamOut,
    TeamsOut,
    TokenOut,
    TokensOut,
)
from server.clock import DAY_US, day_start_us, format_utc
from server.enums import TokenScope
from server.settings import RegistrationSettings
from server.store import OverLimit, Store, tables, teams, tokens

router = APIRouter(tags=["teams and tokens"])
registration_router = APIRouter(tags=["teams and tokens"])
VISITOR = "visitor"
"""Who registers, in the audit log."""


@router.get("/me", responses=document_problems(401))
def who_am_i(caller: AnyCaller, services: ServicesDep) -> MeOut:
    """Return the holder of this token, e.g. to test it."""
    if caller.team is None:
        return MeOut(scope=caller.scope, team=None)
    with services.store.read() as session:
        return MeOut(scope=caller.scope, team=to_team(teams.get(session, caller.team)))


@router.get("/teams", responses=document_problems(401, 403))
def list_teams(_caller: AdminCaller, services: ServicesDep) -> TeamsOut:
    """Return all teams by name."""
    with services.store.read() as session:
        return TeamsOut(items=[to_team(each) for each in teams.list_teams(session)])


@router.post("/teams", status_code=201, responses=document_problems(400, 401, 403, 408, 413, 422))
def create_team(new: NewTeamIn, caller: AdminCaller, services: ServicesDep, at_us: Now) -> TeamOut:
    """Create a team."""
    with services.store.write() as session:
        return to_team(teams.create(session, new.name, at_us, caller.actor))


@router.put("/teams/{name}/hidden", responses=document_problems(400, 401, 403, 404, 408, 413, 422))
def hide_team(name: TeamName, wish: HideIn, caller: AdminCaller, services: ServicesDep, at_us: Now) -> TeamOut:
    """Hide a team (name or id) from the leaderboards, or show it again."""
    with services.store.write() as session:
        team = teams.get(session, name)
        teams.set_hidden(session, team.id, wish.hidden, at_us, caller.actor)
    services.leaderboards.invalidate()
    return to_team(team)


@router.get("/teams/{name}/tokens", responses=document_problems(401, 403, 404, 422))
def list_tokens(name: TeamName, _caller: AdminCaller, services: ServicesDep) -> TokensOut:
    """Return the tokens of a team (name or id), revoked ones included."""
    with services.store.read() as session:
        team = teams.get(session, name)
        return TokensOut(items=[_to_token(each) for each in tokens.list_tokens(session, team)])


@router.post("/tokens", status_code=201, responses=document_problems(400, 401, 403, 404, 408, 413, 422))
def issue_token(new: NewTokenIn, caller: AdminCaller, services: ServicesDep, at_us: Now) -> IssuedTokenOut:
    """Issue a token. Its text is in this response only."""
    with services.store.write() as session:
        holder = teams.get(session, new.team) if new.team is not None else None
        return IssuedTokenOut(token=tokens.issue(session, holder, new.scope, at_us, caller.actor))


@router.delete("/tokens/{token}", status_code=204, responses=document_problems(401, 403, 404, 422))
def revoke_token(token: Id, caller: AdminCaller, services: ServicesDep, at_us: Now) -> None:
    """Revoke a token."""
    with services.store.write() as session:
        tokens.revoke(session, token, at_us, caller.actor)


def to_team(row: tables.TeamRow) -> TeamOut:
    """Return a team as the API shows it."""
    return TeamOut(id=row.id, name=row.name, created=to_datetime(row.created_us), hidden=row.hidden)


def _to_token(row: tables.TokenRow) -> TokenOut:
    revoked = to_datetime(row.revoked_us) if row.revoked_us is not None else None
    return TokenOut(
        id=row.id,
        team=row.team,
        scope=TokenScope(row.scope),
        created=to_datetime(row.created_us),
        revoked=revoked,
    )


@registration_router.post("/register", status_code=201, responses=document_problems(400, 403, 408, 413, 422, 429))
def register(new: NewTeamIn, services: ServicesDep, at_us: Now) -> RegisteredOut:
    """Register a team where registration is open. Its token is in this response only."""
    made = register_team(services.store, services.settings.registration, new.name, at_us)
    return RegisteredOut(team=to_team(made.team), token=made.token)


class RegisteredTeam(NamedTuple):
    """A new team and its first token."""

    team: tables.TeamRow
    token: str
    """Text of the token, which is not stored."""


def register_team(store: Store, settings: RegistrationSettings, name: str, now_us: int) -> RegisteredTeam:
    """Create a team and its token in one transaction.

    Raises ProblemError (403) where registration is closed, OverLimit, and InputError for an unusable name.
    """
    if not settings.open:
        sentence = "registration is closed: ask the organisers for a team and its token"
        raise ProblemError(HTTPStatus.FORBIDDEN, "closed", sentence)
    with store.write() as session:
        today = (
            select(func.count()).select_from(tables.TeamRow).where(tables.TeamRow.created_us >= day_start_us(now_us))
        )
        if (session.scalar(today) or 0) >= settings.per_day:
            tomorrow = day_start_us(now_us) + DAY_US
            retry = format_utc(tomorrow)
            sentence = f"all {settings.per_day} registrations of today are used; the next one is possible at {retry}"
            raise OverLimit("day", sentence, tomorrow)
        team = teams.create(session, name, now_us, VISITOR)
        return RegisteredTeam(team, tokens.issue(session, team, TokenScope.SUBMIT, now_us, VISITOR))
