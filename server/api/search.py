"""Search teams and submissions by name, among those that the caller may see."""

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from server.api import submission_views
from server.api.caller import Caller
from server.api.schemas.leaderboards import FoundTeamOut, SearchOut
from server.store.tables import SubmissionRow, TeamRow

MAX_FOUND = 20
"""Teams, and submissions, of one answer."""


def search_names(session: Session, caller: Caller | None, text: str) -> SearchOut:
    """Return what contains the text in its name or has it as its id; upper and lower case are the same (ASCII).

    Teams are found by everyone only if a visible submission shows their name anyway.
    """
    visible = submission_views.is_visible(caller)
    shown_teams = select(SubmissionRow.team).where(visible)
    team_names = or_(TeamRow.name.icontains(text, autoescape=True), TeamRow.id == text)
    method_names = or_(SubmissionRow.name.icontains(text, autoescape=True), SubmissionRow.id == text)
    own = caller.team if caller is not None else None
    is_admin = caller is not None and caller.is_admin
    teams = select(TeamRow).where(team_names)
    if not is_admin:
        teams = teams.where(or_(TeamRow.id.in_(shown_teams), TeamRow.id == own))
    order = (SubmissionRow.created_us.desc(), SubmissionRow.id)
    submissions = select(SubmissionRow).where(visible, method_names).order_by(*order)
    found_teams = session.scalars(teams.order_by(TeamRow.name).limit(MAX_FOUND + 1)).all()
    found = session.scalars(submissions.limit(MAX_FOUND + 1)).all()
    return SearchOut(
        teams=[FoundTeamOut(id=team.id, name=team.name) for team in found_teams[:MAX_FOUND]],
        submissions=[submission_views.to_submission(session, caller, each) for each in found[:MAX_FOUND]],
        more=max(len(found_teams), len(found)) > MAX_FOUND,
    )
