"""The authenticated holder of a token, for the API and for the pages."""

from dataclasses import dataclass

from server.enums import TokenScope
from server.store import Store, tokens


@dataclass(frozen=True, slots=True)
class Caller:
    """The holder of a valid token."""

    token: str
    """Id of the token."""
    team: str | None
    """Id of the team; None for tokens of admins and workers."""
    scope: TokenScope

    @property
    def is_admin(self) -> bool:
        """Whether the token has the scope admin."""
        return self.scope is TokenScope.ADMIN

    @property
    def actor(self) -> str:
        """Name of the caller in the audit log."""
        return f"{self.scope}:{self.team or self.token}"


def find_caller(store: Store, text: str) -> Caller | None:
    """Return the holder of the token with this text, None if the token is unknown or revoked."""
    with store.read() as session:
        token = tokens.find_token(session, text)
        return Caller(token.id, token.team, TokenScope(token.scope)) if token else None
