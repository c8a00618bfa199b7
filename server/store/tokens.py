"""Tokens: 256 random bits, shown once; the database keeps their hash only."""

import hashlib
import secrets
from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.enums import TokenScope
from server.store import audit
from server.store.errors import NotFound, new_id
from server.store.tables import TeamRow, TokenRow

PREFIX = "mdrive_"
"""So that a secret scanner finds a token someone committed."""


def issue(session: Session, team: TeamRow | None, scope: TokenScope, now_us: int, actor: str = "admin") -> str:
    """The text of a new token: the only time anyone sees it. Raises InputError unless scope and team fit."""
    if (scope is TokenScope.SUBMIT) != (team is not None):
        raise InputError(f"token: scope {scope} expects {'a' if scope is TokenScope.SUBMIT else 'no'} team")
    text = PREFIX + secrets.token_urlsafe(32)
    token = TokenRow(
        id=new_id(), team=team.id if team else None, hash=compute_hash(text), scope=scope.value, created_us=now_us
    )
    session.add(token)
    session.flush()
    audit.add_entry(
        session, actor, "token-issued", {"token": token.id, "team": token.team, "scope": token.scope}, now_us
    )
    return text


def find_token(session: Session, text: str) -> TokenRow | None:
    """Whose token that is; None if it never was one or is revoked."""
    return session.scalar(select(TokenRow).where(TokenRow.hash == compute_hash(text), TokenRow.revoked_us.is_(None)))


def list_tokens(session: Session, team: TeamRow | None) -> Sequence[TokenRow]:
    """Tokens of a team, or of admins and workers; the oldest first."""
    return session.scalars(
        select(TokenRow).where(TokenRow.team == (team.id if team else None)).order_by(TokenRow.created_us)
    ).all()


def revoke(session: Session, token_id: str, now_us: int, actor: str = "admin") -> None:
    """From now on nobody holds it; a second time changes nothing. Raises NotFound."""
    token = session.get(TokenRow, token_id)
    if token is None:
        raise NotFound(f"token: there is no {token_id!r}")
    if token.revoked_us is None:
        token.revoked_us = now_us
        audit.add_entry(session, actor, "token-revoked", {"token": token.id, "team": token.team}, now_us)


def compute_hash(text: str) -> str:
    """SHA-256: a slow hash is for passwords; nobody guesses 256 random bits."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
