"""The audit log: append-only, each entry hashed together with the one before, so that a change in the middle shows.

A chain cannot show that its end was cut off: note `head` somewhere else (it stands in every backup).
"""

import hashlib
import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.store.tables import AuditEntryRow

_EMPTY_HEAD = ""


@dataclass(frozen=True, slots=True)
class AuditReport:
    """What a walk along the chain found."""

    entries: int
    head: str
    """Hash of the last entry."""
    broken: int | None
    """Id of the first entry that does not fit to the one before; None if all do."""


def add_entry(session: Session, actor: str, deed: str, data: dict[str, Any], now_us: int) -> None:
    """Notes who did what; in the transaction of the deed, so that neither is there without the other."""
    session.flush()
    hash_ = _compute_hash(find_head(session), now_us, actor, deed, data)
    session.add(AuditEntryRow(at_us=now_us, actor=actor, deed=deed, data=data, hash=hash_))
    session.flush()


def find_head(session: Session) -> str:
    """Hash of the last entry, "" before the first."""
    return session.scalar(select(AuditEntryRow.hash).order_by(AuditEntryRow.id.desc()).limit(1)) or _EMPTY_HEAD


def find_last(session: Session, apart_from: Collection[str]) -> str:
    """Hash of the last entry of another deed than these, "" before the first."""
    other = select(AuditEntryRow.hash).where(AuditEntryRow.deed.not_in(apart_from))
    return session.scalar(other.order_by(AuditEntryRow.id.desc()).limit(1)) or _EMPTY_HEAD


def list_latest(session: Session, most: int, deed: str | None = None) -> Sequence[AuditEntryRow]:
    """The latest entries, or those of one kind; the newest first."""
    wanted = select(AuditEntryRow) if deed is None else select(AuditEntryRow).where(AuditEntryRow.deed == deed)
    return session.scalars(wanted.order_by(AuditEntryRow.id.desc()).limit(most)).all()


def count_spot_check_differences(session: Session) -> int:
    """How many spot checks found something else than before."""
    checks = select(func.count()).where(AuditEntryRow.deed == "spot-check")
    return session.scalar(checks.where(AuditEntryRow.data["same"].as_boolean().is_(False))) or 0


def verify_chain(session: Session) -> AuditReport:
    """Walks the whole chain."""
    before, entries, broken = _EMPTY_HEAD, 0, None
    for entry in session.scalars(select(AuditEntryRow).order_by(AuditEntryRow.id).execution_options(yield_per=500)):
        entries += 1
        expected = _compute_hash(before, entry.at_us, entry.actor, entry.deed, entry.data)
        if broken is None and entry.hash != expected:
            broken = entry.id
        before = entry.hash
    return AuditReport(entries, before, broken)


def _compute_hash(before: str, at_us: int, actor: str, deed: str, data: dict[str, Any]) -> str:
    text = json.dumps([before, at_us, actor, deed, data], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
