"""The database of the challenge: SQLite for a single server, PostgreSQL for larger ones, with the same behaviour."""

from server.errors import StoreUnavailable
from server.store.engine import Store
from server.store.errors import NotFound, NotNow, OverLimit

__all__ = ["NotFound", "NotNow", "OverLimit", "Store", "StoreUnavailable"]
