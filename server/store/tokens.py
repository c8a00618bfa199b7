"""Tokens of 256 random bits, shown once; the database stores their hash only."""

import hashlib
import secrets
from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.enums import TokenScope
from server.errors import NotFound, new_id
from server.store import audit
from server.store.tables import TeamRow, TokenRow

PREFIX = "mdrive_"
"""Lets secret scanners find committed tokens."""


def issue(session: Session, team: TeamRow | None, scope: TokenScope, now_us: int, actor: str = "admin") -> str:
    """Create a token and return its text, which is not stored. Raises InputError unless scope and team fit."""
    if (scope is TokenScope.SUBMIT) != (team is not None):
        raise InputError(f"token: scope {scope} expects {'a' if scope is TokenScope.SUBMIT else 'no'} team")
    text = PREFIX + secrets.token_urlsafe(32)
    token = TokenRow(
        id=new_id(), team=team.id if team else None, hash=compute_hash(text), scope=scope.value, created_us=now_us
    )
    session.add(token)
    session.flush()
    entry = {"token": token.id, "team": token.team, "scope": token.scope, "hash": token.hash}
    audit.add_entry(session, actor, "token-issued", entry, now_us)
    return text


def find_token(session: Session, text: str) -> TokenRow | None:
    """Return the token of this text; None if it is unknown or revoked."""
    return session.scalar(select(TokenRow).where(TokenRow.hash == compute_hash(text), TokenRow.revoked_us.is_(None)))


def is_valid(session: Session, token_id: str) -> bool:
    """Return whether the token exists and is not revoked: for requests that last, such as streams of events."""
    token = session.get(TokenRow, token_id)
    return token is not None and token.revoked_us is None


def list_tokens(session: Session, team: TeamRow | None) -> Sequence[TokenRow]:
    """Return the tokens of a team, or of admins and workers (None); the oldest first."""
    return session.scalars(
        select(TokenRow).where(TokenRow.team == (team.id if team else None)).order_by(TokenRow.created_us)
    ).all()


def get(session: Session, token_id: str) -> TokenRow:
    """Return a token. Raises NotFound."""
    token = session.get(TokenRow, token_id)
    if token is None:
        raise NotFound(f"token: there is no {token_id!r}")
    return token


def revoke(session: Session, token_id: str, now_us: int, actor: str = "admin") -> None:
    """Revoke a token; a second time changes nothing. Raises NotFound."""
    token = get(session, token_id)
    if token.revoked_us is None:
        token.revoked_us = now_us
        audit.add_entry(session, actor, "token-revoked", {"token": token.id, "team": token.team}, now_us)


def compute_hash(text: str) -> str:
    """Return the SHA-256 of a token: 256 random bits need no slow password hash."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
