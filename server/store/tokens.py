"""Tokens: 256 random bits, shown once; the database keeps their hash only."""

import hashlib
import secrets
from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.enums import Scope
from server.store import audit
from server.store.errors import NotFound, new_id
from server.store.tables import Team, Token

PREFIX = "mdrive_"
"""So that a secret scanner finds a token someone committed."""


def issue(session: Session, team: Team | None, scope: Scope, now_us: int, actor: str = "admin") -> str:
    """The text of a new token: the only time anyone sees it. Raises InputError unless scope and team fit."""
    if (scope is Scope.SUBMIT) != (team is not None):
        raise InputError(f"token: scope {scope} expects {'a' if scope is Scope.SUBMIT else 'no'} team")
    text = PREFIX + secrets.token_urlsafe(32)
    token = Token(id=new_id(), team=team.id if team else None, hash=hashed(text), scope=scope.value, created_us=now_us)
    session.add(token)
    session.flush()
    audit.add(session, actor, "token-issued", {"token": token.id, "team": token.team, "scope": token.scope}, now_us)
    return text


def holder(session: Session, text: str) -> Token | None:
    """Whose token that is; None if it never was one or is revoked."""
    return session.scalar(select(Token).where(Token.hash == hashed(text), Token.revoked_us.is_(None)))


def every(session: Session, team: Team | None) -> Sequence[Token]:
    """Tokens of a team, or of admins and workers; the oldest first."""
    return session.scalars(
        select(Token).where(Token.team == (team.id if team else None)).order_by(Token.created_us)
    ).all()


def revoke(session: Session, token_id: str, now_us: int, actor: str = "admin") -> None:
    """From now on nobody holds it; a second time changes nothing. Raises NotFound."""
    token = session.get(Token, token_id)
    if token is None:
        raise NotFound(f"token: there is no {token_id!r}")
    if token.revoked_us is None:
        token.revoked_us = now_us
        audit.add(session, actor, "token-revoked", {"token": token.id, "team": token.team}, now_us)


def hashed(text: str) -> str:
    """SHA-256: a slow hash is for passwords; nobody guesses 256 random bits."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
