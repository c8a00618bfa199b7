"""The database of the challenge: SQLite for a single server, PostgreSQL for larger ones, with the same behaviour."""

from server.errors import NotFound, NotNow, OverLimit, StoreUnavailable
from server.store.engine import Store

__all__ = ["NotFound", "NotNow", "OverLimit", "Store", "StoreUnavailable"]
