"""The server's only clock. The outermost layer reads it once and passes the number down, so tests control the time."""

import time
from datetime import UTC, datetime

from mdrive_sumo.core.errors import InputError

HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US


def now_us() -> int:
    """Return the time in microseconds since 1970, UTC."""
    return time.time_ns() // 1000


def day_start_us(at_us: int) -> int:
    """Return the start of the UTC day of `at_us`; daily quotas count UTC days."""
    return at_us - at_us % DAY_US


def format_utc(at_us: int) -> str:
    """Format a time as 2026-01-31 12:00:00 UTC. Raises InputError for what a damaged database has instead."""
    try:
        return f"{datetime.fromtimestamp(at_us // 1_000_000, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"database: expected a time in microseconds since 1970, found {str(at_us)[:40]!r}") from None
