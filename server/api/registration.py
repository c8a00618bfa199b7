"""Teams that make themselves, where the settings let them: for the API and for the pages."""

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
    """A new team."""

    team: tables.TeamRow
    token: str
    """Its text, which nobody sees again."""


def register(store: Store, settings: RegistrationSettings, name: str, now_us: int) -> RegisteredTeam:
    """A team and its token, or neither. Raises ProblemError where it is closed, OverLimit, InputError for the name."""
    if not settings.open:
        sentence = "teams are made by those who run this server: ask them for one, and for its token"
        raise ProblemError(HTTPStatus.FORBIDDEN, "closed", sentence)
    with store.write() as session:
        today = (
            select(func.count()).select_from(tables.TeamRow).where(tables.TeamRow.created_us >= day_start_us(now_us))
        )
        if (session.scalar(today) or 0) >= settings.per_day:
            tomorrow = day_start_us(now_us) + DAY_US
            sentence = (
                f"all {settings.per_day} teams of today are made; the next one can be made at {format_utc(tomorrow)}"
            )
            raise OverLimit("day", sentence, tomorrow)
        team = teams.create(session, name, now_us, _ACTOR)
        return RegisteredTeam(team, tokens.issue(session, team, TokenScope.SUBMIT, now_us, _ACTOR))
