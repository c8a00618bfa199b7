"""Self-registration of teams, where the settings allow it; for the API and for the pages."""

from http import HTTPStatus
from typing import NamedTuple

from sqlalchemy import func, select

from server.api.problems import ProblemError
from server.clock import DAY_US, day_start_us, format_utc
from server.enums import TokenScope
from server.settings import RegistrationSettings
from server.store import OverLimit, Store, tables, teams, tokens

_ACTOR = "visitor"


class RegisteredTeam(NamedTuple):
    """A new team and its first token."""

    team: tables.TeamRow
    token: str
    """Text of the token, which is not stored."""


def register(store: Store, settings: RegistrationSettings, name: str, now_us: int) -> RegisteredTeam:
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
        team = teams.create(session, name, now_us, _ACTOR)
        return RegisteredTeam(team, tokens.issue(session, team, TokenScope.SUBMIT, now_us, _ACTOR))
