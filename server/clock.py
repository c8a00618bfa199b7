"""The server's only clock. The outermost layer reads it once and hands the number down, so tests own the time."""

import time
from datetime import UTC, datetime

DAY_US = 86_400_000_000


def now_us() -> int:
    """Microseconds since 1970 in UTC."""
    return time.time_ns() // 1000


def day_start_us(at_us: int) -> int:
    """Start of the UTC day that `at_us` lies in: quotas count these days wherever a team lives."""
    return at_us - at_us % DAY_US


def format_utc(at_us: int) -> str:
    """As people read it: 2026-01-31 12:00:00 UTC."""
    return f"{datetime.fromtimestamp(at_us // 1_000_000, UTC):%Y-%m-%d %H:%M:%S} UTC"
