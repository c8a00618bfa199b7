"""The database of the challenge: SQLite beside a single server, PostgreSQL where it grows; the same rules on both."""

from server.store.engine import Store, StoreUnavailable
from server.store.errors import NotFound, NotNow, OverLimit

__all__ = ["NotFound", "NotNow", "OverLimit", "Store", "StoreUnavailable"]
