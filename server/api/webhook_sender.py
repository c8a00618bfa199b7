"""Sends the notifications of webhooks, in a thread beside the API: no request and no transaction waits for a receiver.

The format is Standard Webhooks (https://www.standardwebhooks.com): a receiver verifies `webhook-signature` with the
secret, and drops a `webhook-id` that it has seen, because a notification can arrive twice.
"""

import asyncio
import base64
import hashlib
import hmac
import json
import logging
import threading
from collections.abc import Callable, Sequence

import httpx
from sqlalchemy.orm import Session

from server import clock
from server.api import submission_views
from server.api.submission_views import Caller
from server.api.webhook_address import (
    AddressRefused,
    Resolver,
    check_url,
    find_address,
    find_host,
    resolve_host,
)
from server.enums import TokenScope
from server.settings import WebhookSettings
from server.store import Store, StoreUnavailable, submissions, webhooks
from server.store.webhooks import DueDelivery

LOG = logging.getLogger("mdrive.webhooks")
POLL_S = 2.0
"""Pause between looks for notifications that are due [s]: the end of a submission is told a few seconds later."""
BATCH = 8
"""Notifications that are sent at a time, each of another team."""
_EVENT = "submission.finished"


class WebhookSender:
    """Runs in a thread between `start` and `stop`."""

    def __init__(
        self,
        store: Store,
        settings: WebhookSettings,
        now: Callable[[], int] = clock.now_us,
        resolve: Resolver = resolve_host,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        """`transport`: replaces the network, for tests."""
        self._store, self._settings, self._now = store, settings, now
        self._resolve, self._transport = resolve, transport
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="webhooks", daemon=True)

    def start(self) -> None:
        """Start."""
        self._thread.start()

    def stop(self) -> None:
        """Stop after the batch under way, at most `timeout_s` later; what was not sent is sent after the next start."""
        self._stopping.set()
        self._thread.join(self._settings.timeout_s + 1.0)

    def send_due(self) -> int:
        """Send what is due, one notification for each team; return how many. Raises StoreUnavailable."""
        with self._store.read() as session:
            if not webhooks.is_any_due(session, self._now()):
                return 0
        with self._store.write() as session:
            claimed = webhooks.claim_due(session, BATCH, self._now())
        with self._store.read() as session:
            bodies = [_make_body(session, each) for each in claimed]
        problems = asyncio.run(self._send_all(claimed, bodies)) if claimed else []
        with self._store.write() as session:
            for each, problem in zip(claimed, problems, strict=True):
                webhooks.record_attempt(session, each.id, problem, self._now())
        return len(claimed)

    def _run(self) -> None:
        while not self._stopping.is_set():
            try:
                sent = self.send_due()
            except StoreUnavailable as error:
                LOG.warning("notifications wait: %s", error)
                sent = 0
            if not sent:
                self._stopping.wait(POLL_S)

    async def _send_all(self, claimed: Sequence[DueDelivery], bodies: Sequence[bytes]) -> list[str]:
        async with httpx.AsyncClient(
            transport=self._transport, trust_env=False, follow_redirects=False, timeout=self._settings.timeout_s
        ) as client:
            sends = (self._send(client, each, body) for each, body in zip(claimed, bodies, strict=True))
            return await asyncio.gather(*sends)

    async def _send(self, client: httpx.AsyncClient, delivery: DueDelivery, body: bytes) -> str:
        """Return why an attempt failed, "" if it did not."""
        allowed = self._settings.allowed_hosts
        try:
            async with asyncio.timeout(self._settings.timeout_s):  # httpx limits each wait, not their sum
                url = check_url(delivery.url, allowed)  # the operator's list may have changed
                address = await find_address(url, allowed, delivery.attempt, self._resolve)
                headers = _sign(delivery, body, self._now() // 1_000_000) | {"Host": url.netloc.decode()}
                options = {"sni_hostname": find_host(url)}  # the certificate must be that of the name
                async with client.stream(
                    "POST", url.copy_with(host=address), content=body, headers=headers, extensions=options
                ) as answer:  # the body of the answer is not read
                    return "" if answer.is_success else f"the receiver answered {answer.status_code}"
        except AddressRefused as error:
            return str(error)
        except TimeoutError:
            return f"no answer within {self._settings.timeout_s:g} s"
        except (httpx.HTTPError, httpx.InvalidURL, OSError, UnicodeError):
            return "the receiver cannot be reached"


def _make_body(session: Session, delivery: DueDelivery) -> bytes:
    """Return the submission as its team sees it in the API."""
    team = Caller("", delivery.team, TokenScope.SUBMIT)
    submission = submissions.get(session, delivery.submission)
    shown = submission_views.to_submission(session, team, submission).model_dump(mode="json")
    content = {"type": _EVENT, "timestamp": shown["finished"], "data": shown}
    return json.dumps(content, separators=(",", ":")).encode()


def _sign(delivery: DueDelivery, body: bytes, at_s: int) -> dict[str, str]:
    """Return the headers of Standard Webhooks: the signature covers id, time and body."""
    key = base64.b64decode(delivery.secret.removeprefix(webhooks.SECRET_PREFIX))
    mac = hmac.new(key, f"{delivery.id}.{at_s}.".encode() + body, hashlib.sha256)
    return {
        "Content-Type": "application/json",
        "User-Agent": "mdrive-sumo",
        "webhook-id": delivery.id,
        "webhook-timestamp": str(at_s),
        "webhook-signature": f"v1,{base64.b64encode(mac.digest()).decode()}",
    }
