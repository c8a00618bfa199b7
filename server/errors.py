"""The error of the store that child processes pass on: here, because most of them need no store and no SQLAlchemy."""


class StoreUnavailable(Exception):
    """The database does not answer, is locked for too long, or is full. Nothing was written."""
