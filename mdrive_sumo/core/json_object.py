"""JSON objects in texts of files that may be a stranger's."""

import json
from typing import Any


def parse_json_object(text: str, name: str) -> dict[str, Any]:
    """Return the JSON object of a text. name: what it is, for the sentence.

    Raises ValueError for anything else, also for lists in lists that are deeper than Python reads.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError(f"{name}: expected a JSON object, found {text!r:.60}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{name}: expected a JSON object, found {text!r:.60}")
    return content
