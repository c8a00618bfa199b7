"""Webhooks of teams and their notifications: queued with the end of a submission, claimed and sent later.

Every claim counts as an attempt before anything is sent, so that a notification is tried a bounded number of times
even if the server crashes while it sends.
"""

import base64
import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from server.enums import DeliveryState
from server.errors import new_id
from server.store import audit
from server.store.audit import compute_checksum
from server.store.tables import SubmissionRow, WebhookDeliveryRow, WebhookRow

DELAYS_US = tuple(minutes * 60_000_000 for minutes in (1, 5, 30, 120))
"""Time from an attempt to the next one [us]; after the last attempt a notification has failed."""
MAX_ATTEMPTS = len(DELAYS_US) + 1
"""Attempts of a notification, the first one included."""
KEPT_US = 30 * 86_400_000_000
"""Age at which notifications that are delivered or failed are deleted [us]."""
SECRET_PREFIX = "whsec_"


@dataclass(frozen=True, slots=True)
class DueDelivery:
    """A claimed notification."""

    id: str
    submission: str
    team: str
    url: str
    secret: str
    attempt: int
    """Number of this attempt; 1 is the first."""


def set_webhook(session: Session, team: str, url: str, now_us: int, actor: str) -> str:
    """Set the webhook of a team, and return its new secret."""
    secret = SECRET_PREFIX + base64.b64encode(secrets.token_bytes(32)).decode()
    session.merge(WebhookRow(team=team, url=url, secret=secret, created_us=now_us))
    audit.add_entry(session, actor, "webhook-set", {"team": team} | compute_webhook_checksums(url, secret), now_us)
    return secret


def compute_webhook_checksums(url: str, secret: str) -> dict[str, str]:
    """Return what the audit log holds of a webhook: checksums, because an address can contain a secret, too."""
    return {"url_sha256": compute_checksum(url), "secret_sha256": compute_checksum(secret)}


def remove_webhook(session: Session, team: str, now_us: int, actor: str) -> None:
    """Remove the webhook of a team, with the notifications that wait; does nothing without one."""
    if (webhook := find_webhook(session, team)) is None:
        return
    waiting = WebhookDeliveryRow.state == DeliveryState.WAITING
    session.execute(delete(WebhookDeliveryRow).where(WebhookDeliveryRow.team == team, waiting))
    session.delete(webhook)
    audit.add_entry(session, actor, "webhook-removed", {"team": team}, now_us)


def find_webhook(session: Session, team: str) -> WebhookRow | None:
    """Return the webhook of a team."""
    return session.get(WebhookRow, team)


def list_deliveries(session: Session, team: str, limit: int) -> Sequence[WebhookDeliveryRow]:
    """Return the latest notifications of a team, the newest first."""
    of_team = select(WebhookDeliveryRow).where(WebhookDeliveryRow.team == team)
    return session.scalars(of_team.order_by(WebhookDeliveryRow.created_us.desc()).limit(limit)).all()


def enqueue(session: Session, submission: SubmissionRow, now_us: int) -> None:
    """Queue the notification of a submission's new final state, if its team has a webhook."""
    if find_webhook(session, submission.team) is None:
        return
    due = {"state": DeliveryState.WAITING.value, "attempts": 0, "next_us": now_us, "created_us": now_us, "problem": ""}
    session.add(WebhookDeliveryRow(id=new_id(), submission=submission.id, team=submission.team, **due))


def is_any_due(session: Session, now_us: int) -> bool:
    """Return whether a claim is worth a write transaction."""
    due = (WebhookDeliveryRow.state == DeliveryState.WAITING, WebhookDeliveryRow.next_us <= now_us)
    return session.scalar(select(WebhookDeliveryRow.id).where(*due).limit(1)) is not None


def claim_due(session: Session, limit: int, now_us: int) -> list[DueDelivery]:
    """Claim notifications whose time has come, the oldest first, at most one for each team."""
    due = select(WebhookDeliveryRow, WebhookRow).join(WebhookRow, WebhookRow.team == WebhookDeliveryRow.team)
    due = due.where(WebhookDeliveryRow.state == DeliveryState.WAITING, WebhookDeliveryRow.next_us <= now_us)
    claimed: dict[str, DueDelivery] = {}
    for row, webhook in session.execute(due.order_by(WebhookDeliveryRow.next_us, WebhookDeliveryRow.id)):
        if row.attempts >= MAX_ATTEMPTS:  # its last attempt was never recorded
            row.state, row.problem = DeliveryState.FAILED.value, "the server ended while it sent the last attempt"
        elif row.team not in claimed and len(claimed) < limit:
            row.attempts += 1
            row.next_us = now_us + DELAYS_US[min(row.attempts, len(DELAYS_US)) - 1]
            claimed[row.team] = DueDelivery(row.id, row.submission, row.team, webhook.url, webhook.secret, row.attempts)
    return list(claimed.values())


def record_attempt(session: Session, delivery: str, problem: str, now_us: int) -> None:
    """Record the result of an attempt, "" for success; does nothing if the webhook was removed meanwhile."""
    row = session.get(WebhookDeliveryRow, delivery)
    if row is None or row.state != DeliveryState.WAITING:
        return
    row.problem = problem
    if not problem:
        row.state = DeliveryState.DELIVERED.value
    elif row.attempts >= MAX_ATTEMPTS:
        row.state = DeliveryState.FAILED.value
    else:
        row.next_us = max(row.next_us, now_us + DELAYS_US[row.attempts - 1])


def delete_old(session: Session, now_us: int) -> None:
    """Delete notifications that were delivered or failed long ago."""
    ended = WebhookDeliveryRow.state != DeliveryState.WAITING
    session.execute(delete(WebhookDeliveryRow).where(ended, WebhookDeliveryRow.created_us < now_us - KEPT_US))
