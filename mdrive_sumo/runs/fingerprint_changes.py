"""What differs between the fingerprints of two runs, in words."""

import json
from itertools import takewhile
from typing import Any

MAX_CHANGES = 4
"""Changed settings of a channel or an agent that a message names."""


def describe_change(key: str, before: object, now: object) -> str:
    """Return "seed 0 (now 1)"; of settings that are a JSON object, such as the channel's, what differs in them."""
    settings, new_settings = _parse_settings(before), _parse_settings(now)
    if settings is not None and new_settings is not None:
        names = [name for name in sorted({*settings, *new_settings}) if settings.get(name) != new_settings.get(name)]
        changes = [f"{name} {_shorten(settings.get(name))} (now {_shorten(new_settings.get(name))})" for name in names]
        left_out = f" and {len(changes) - MAX_CHANGES} more" if len(changes) > MAX_CHANGES else ""
        return f"{key}: {', '.join(changes[:MAX_CHANGES])}{left_out}"
    old, new = _shorten(before), _shorten(now)
    if old == new:  # long texts that begin alike
        alike = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(str(before), str(now), strict=False)))
        old, new = (f"...{_shorten(str(value)[max(0, alike - 4) :])}" for value in (before, now))
    return f"{key} {old} (now {new})"


def _parse_settings(value: object) -> dict[str, Any] | None:
    """Return the settings that a value of a fingerprint holds as JSON; None for other values."""
    if not isinstance(value, str) or not value.startswith("{"):
        return None
    try:
        settings = json.loads(value)
    except (ValueError, RecursionError):
        return None
    return settings if isinstance(settings, dict) else None


def _shorten(value: object) -> str:
    text = "none" if value is None else str(value).removeprefix("sha256:")
    return text if len(text) <= 24 else text[:12] + "..."
