"""The participating teams."""

import re
import unicodedata
from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.errors import NotFound, check_text, new_id
from server.store import audit
from server.store.tables import TeamRow

_ID = re.compile(r"[0-9a-f]{32}", re.IGNORECASE)


def create(session: Session, name: str, now_us: int, actor: str = "admin") -> TeamRow:
    """Create a team. Raises InputError if the name is taken or unusable."""
    name = check_name(name)
    if any(_normalise_name(name) == _normalise_name(taken) for taken in session.scalars(select(TeamRow.name))):
        raise InputError(f"name of a team: {name!r} is taken, or looks like one that is")
    team = TeamRow(id=new_id(), name=name, created_us=now_us)
    session.add(team)
    session.flush()
    audit.add_entry(session, actor, "team-created", {"team": team.id, "name": name}, now_us)
    return team


def check_name(name: str) -> str:
    """Return a name as it is stored. Raises InputError if no team can have it."""
    name = check_text(name, "name of a team", 64)
    if _ID.fullmatch(name):
        raise InputError(f"name of a team: expected one that does not look like an id, found {name!r}")
    return name


def _normalise_name(name: str) -> str:
    """Return a key that is equal for names that differ in case, width or spaces only."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def get(session: Session, name_or_id: str) -> TeamRow:
    """Return the team of that name, else of that id. Raises NotFound."""
    team = session.scalar(select(TeamRow).where(TeamRow.name == name_or_id)) or session.get(TeamRow, name_or_id)
    if team is None:
        raise NotFound(f"team: there is no {name_or_id!r}")
    return team


def list_teams(session: Session) -> Sequence[TeamRow]:
    """Return all teams by name."""
    return session.scalars(select(TeamRow).order_by(TeamRow.name)).all()


def set_hidden(session: Session, team_id: str, hidden: bool, now_us: int, actor: str = "admin") -> None:
    """Hide a team from the leaderboards, or show it again."""
    team = get(session, team_id)
    team.hidden = hidden
    audit.add_entry(session, actor, "team-hidden" if hidden else "team-shown", {"team": team.id}, now_us)
