"""The webhook of the token's team: one address that is notified of the end of each submission."""

from http import HTTPStatus

from fastapi import APIRouter

from server.api.dependencies import Now, ServicesDep, TeamCaller
from server.api.problems import ProblemError, document_problems
from server.api.schemas.parameters import to_datetime
from server.api.schemas.teams import DeliveryOut, NewWebhookIn, WebhookOut, WebhookSecretOut
from server.api.webhook_address import check_url
from server.enums import DeliveryState
from server.store import webhooks

router = APIRouter(tags=["webhook"])
LISTED = 10
"""Latest notifications that are listed."""


@router.get("/webhook", responses=document_problems(401, 403))
def show_webhook(member: TeamCaller, services: ServicesDep) -> WebhookOut:
    """Return your team's webhook and its latest notifications."""
    with services.store.read() as session:
        webhook = webhooks.find_webhook(session, member.team)
        sent = webhooks.list_deliveries(session, member.team, LISTED)
        return WebhookOut(
            enabled=services.settings.webhooks.enabled,
            url=webhook.url if webhook is not None else None,
            created=to_datetime(webhook.created_us) if webhook is not None else None,
            deliveries=[
                DeliveryOut(
                    id=each.id,
                    submission=each.submission,
                    state=DeliveryState(each.state),
                    attempts=each.attempts,
                    problem=each.problem,
                )
                for each in sent
            ],
        )


@router.put("/webhook", responses=document_problems(400, 401, 403, 408, 413, 422))
def set_webhook(new: NewWebhookIn, member: TeamCaller, services: ServicesDep, at_us: Now) -> WebhookSecretOut:
    """Set your team's webhook, or replace it. Its secret is new, and in this response only.

    The address begins with https:// and is public, unless the operator allows its host.
    """
    if not services.settings.webhooks.enabled:
        sentence = "webhook: this server sends none; its operator enables them with `enabled = true` in `[webhooks]`"
        raise ProblemError(HTTPStatus.FORBIDDEN, "scope", sentence)
    url = str(check_url(new.url, services.settings.webhooks.allowed_hosts))
    with services.store.write() as session:
        secret = webhooks.set_webhook(session, member.team, url, at_us, member.caller.actor)
    return WebhookSecretOut(url=url, secret=secret)


@router.delete("/webhook", status_code=204, responses=document_problems(401, 403))
def remove_webhook(member: TeamCaller, services: ServicesDep, at_us: Now) -> None:
    """Remove your team's webhook; notifications that wait are not sent."""
    with services.store.write() as session:
        webhooks.remove_webhook(session, member.team, at_us, member.caller.actor)
