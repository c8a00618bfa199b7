"""Request and response bodies of teams, tokens and webhooks."""

from datetime import datetime
from typing import Annotated

from pydantic import ConfigDict, Field, StrictBool

from server.api.schemas.parameters import RequestModel, ResponseModel, TeamName
from server.enums import DeliveryState, TokenScope


class NewTeamIn(RequestModel):
    """A team to create."""

    name: TeamName


class HideIn(RequestModel):
    """Whether a team is hidden from leaderboards."""

    hidden: StrictBool


class NewTokenIn(RequestModel):
    """The scope `submit` needs a team, `admin` and `worker` have none."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {"required": ["team"], "properties": {"scope": {"const": "submit"}, "team": {"type": "string"}}},
                {
                    "required": ["scope"],
                    "properties": {"scope": {"enum": ["admin", "worker"]}, "team": {"type": "null"}},
                },
            ]
        }
    )
    scope: TokenScope = TokenScope.SUBMIT
    team: TeamName | None = None


class ShowIn(RequestModel):
    """Whether a submission may be on the leaderboard."""

    shown: StrictBool


class NewWebhookIn(RequestModel):
    """A team's webhook."""

    url: Annotated[str, Field(min_length=1, max_length=500, json_schema_extra={"pattern": "^https?://"})]


class DeliveryOut(ResponseModel):
    """A notification by webhook."""

    id: str
    """The header `webhook-id`."""
    submission: str
    state: DeliveryState
    attempts: int
    problem: str
    """Why the last attempt failed, if it did."""


class WebhookOut(ResponseModel):
    """A team's webhook without its secret."""

    enabled: bool
    """Whether this server sends notifications."""
    url: str | None
    created: datetime | None
    deliveries: list[DeliveryOut]
    """The latest ones, the newest first."""


class WebhookSecretOut(ResponseModel):
    """A new webhook; its secret is shown this once."""

    url: str
    secret: str


class TeamOut(ResponseModel):
    """A participating team."""

    id: str
    name: str
    created: datetime
    hidden: bool


class TeamsOut(ResponseModel):
    """All teams."""

    items: list[TeamOut]


class TokenOut(ResponseModel):
    """A token without its text, which is not stored."""

    id: str
    team: str | None
    scope: TokenScope
    created: datetime
    revoked: datetime | None


class TokensOut(ResponseModel):
    """Tokens, the oldest first."""

    items: list[TokenOut]


class IssuedTokenOut(ResponseModel):
    """A new token; its text is shown this once."""

    token: str


class RegisteredOut(ResponseModel):
    """A registered team and its token, which is shown this once."""

    team: TeamOut
    token: str


class MeOut(ResponseModel):
    """The holder of the token."""

    scope: TokenScope
    team: TeamOut | None
