"""Teams: who submits."""

import re
import unicodedata
from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.store import audit
from server.store.errors import NotFound, checked_text, new_id
from server.store.tables import Team

_ID = re.compile(r"[0-9a-f]{32}", re.IGNORECASE)


def create(session: Session, name: str, now_us: int, actor: str = "admin") -> Team:
    """A new team, made by `actor`; raises InputError where the name is taken or unusable."""
    name = checked_text(name, "name of a team", 64)
    if _ID.fullmatch(name):
        raise InputError(f"name of a team: expected one that does not look like an id, found {name!r}")
    if any(_alike(name) == _alike(taken) for taken in session.scalars(select(Team.name))):
        raise InputError(f"name of a team: {name!r} is taken, or looks like one that is")
    team = Team(id=new_id(), name=name, created_us=now_us)
    session.add(team)
    session.flush()
    audit.add(session, actor, "team-created", {"team": team.id, "name": name}, now_us)
    return team


def _alike(name: str) -> str:
    """The same for names that differ in case, width or spaces only."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def get(session: Session, name_or_id: str) -> Team:
    """The team of that name, else of that id; raises NotFound."""
    team = session.scalar(select(Team).where(Team.name == name_or_id)) or session.get(Team, name_or_id)
    if team is None:
        raise NotFound(f"team: there is no {name_or_id!r}")
    return team


def every(session: Session) -> Sequence[Team]:
    """All teams by name."""
    return session.scalars(select(Team).order_by(Team.name)).all()


def hide(session: Session, team_id: str, hidden: bool, now_us: int, actor: str = "admin") -> None:
    """Takes a team off the leaderboards, or puts it back; `actor` does."""
    team = get(session, team_id)
    team.hidden = hidden
    audit.add(session, actor, "team-hidden" if hidden else "team-shown", {"team": team.id}, now_us)
