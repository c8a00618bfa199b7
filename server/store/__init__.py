"""The database of the challenge: SQLite for a single server, PostgreSQL for larger ones, with the same behaviour."""

from typing import TYPE_CHECKING

from server.store.errors import NotFound, NotNow, OverLimit, StoreUnavailable

if TYPE_CHECKING:
    from server.store.engine import Store

__all__ = ["NotFound", "NotNow", "OverLimit", "Store", "StoreUnavailable"]


def __getattr__(name: str) -> object:
    """Import SQLAlchemy only for those that open a database: children of the API that check archives do not."""
    if name != "Store":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from server.store.engine import Store

    return Store
