"""Who asks: for the API and for the pages."""

from dataclasses import dataclass

from server.enums import TokenScope
from server.store import Store, tokens


@dataclass(frozen=True, slots=True)
class Caller:
    """Who holds the token."""

    token: str
    """Its id."""
    team: str | None
    scope: TokenScope

    @property
    def is_admin(self) -> bool:
        """Whether everything is allowed."""
        return self.scope is TokenScope.ADMIN

    @property
    def actor(self) -> str:
        """For the audit log."""
        return f"{self.scope}:{self.team or self.token}"


def find_caller(store: Store, text: str) -> Caller | None:
    """Who holds a token; None for one that is not valid (any more)."""
    with store.read() as session:
        token = tokens.find_token(session, text)
        return Caller(token.id, token.team, TokenScope(token.scope)) if token else None
