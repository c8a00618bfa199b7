"""The audit log: append-only; each entry's hash covers the hash before it, so that a change in the middle is detected.

A chain cannot show that its end was cut off: store the head elsewhere (every backup contains it).
"""

import hashlib
import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.store.tables import AuditEntryRow, JobRow

_EMPTY_HEAD = ""


@dataclass(frozen=True, slots=True)
class AuditReport:
    """Result of verifying the hash chain."""

    entries: int
    head: str
    """Hash of the last entry; note it elsewhere, because a chain cannot show that its end was cut off."""
    broken: int | None
    """Id of the first entry whose hash does not fit the one before; None if all fit."""


def add_entry(session: Session, actor: str, action: str, data: dict[str, Any], now_us: int) -> None:
    """Append an entry; call it in the transaction of the action, so that both are committed or neither is."""
    session.flush()
    hash_ = _compute_hash(find_head(session), now_us, actor, action, data)
    session.add(AuditEntryRow(at_us=now_us, actor=actor, action=action, data=data, hash=hash_))
    session.flush()


def find_head(session: Session) -> str:
    """Return the hash of the last entry, "" before the first."""
    return session.scalar(select(AuditEntryRow.hash).order_by(AuditEntryRow.id.desc()).limit(1)) or _EMPTY_HEAD


def find_last(session: Session, ignored: Collection[str]) -> str:
    """Return the hash of the last entry whose action is none of `ignored`, "" before the first."""
    other = select(AuditEntryRow.hash).where(AuditEntryRow.action.not_in(ignored))
    return session.scalar(other.order_by(AuditEntryRow.id.desc()).limit(1)) or _EMPTY_HEAD


def list_latest(session: Session, limit: int, action: str | None = None) -> Sequence[AuditEntryRow]:
    """Return the latest `limit` entries, all or those of one action, the newest first."""
    wanted = select(AuditEntryRow) if action is None else select(AuditEntryRow).where(AuditEntryRow.action == action)
    return session.scalars(wanted.order_by(AuditEntryRow.id.desc()).limit(limit)).all()


def count_spot_check_differences(session: Session) -> int:
    """Return how many spot checks found another result than before."""
    checks = select(func.count()).where(AuditEntryRow.action == "spot-check")
    return session.scalar(checks.where(AuditEntryRow.data["same"].as_boolean().is_(False))) or 0


def verify_chain(session: Session) -> AuditReport:
    """Recompute the hashes of the whole chain."""
    before, entries, broken = _EMPTY_HEAD, 0, None
    for entry in session.scalars(select(AuditEntryRow).order_by(AuditEntryRow.id).execution_options(yield_per=500)):
        entries += 1
        expected = _compute_hash(before, entry.at_us, entry.actor, entry.action, entry.data)
        if broken is None and entry.hash != expected:
            broken = entry.id
        before = entry.hash
    return AuditReport(entries, before, broken)


def _compute_hash(before: str, at_us: int, actor: str, action: str, data: dict[str, Any]) -> str:
    text = json.dumps([before, at_us, actor, action, data], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def compute_checksum(value: Any) -> str:
    """Return the SHA-256 of a JSON value, in hexadecimal."""
    return hashlib.sha256(_encode(value)).hexdigest()


def compute_results_checksum(jobs: Sequence[JobRow]) -> str:
    """Return the SHA-256 of the results of a submission's jobs, ordered by scenario and seed, in hexadecimal."""
    digest = hashlib.sha256()
    for job in jobs:
        digest.update(_encode([job.scenario, job.seed, job.verdict, job.reason, job.result]))
    return digest.hexdigest()


def compute_jobs_checksum(jobs: Iterable[tuple[str, int]]) -> str:
    """Return the SHA-256 of the scenarios and seeds that a submission is driven in, in hexadecimal."""
    return compute_checksum(sorted([scenario, seed] for scenario, seed in jobs))


def _encode(value: Any) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
