"""Overviews of finished jobs: what lists show, of bounded size, so that no list depends on what agents produce."""

import json
from collections.abc import Mapping
from typing import Any

SCORES = ("bucket", "category", "ds", "sr", "efficient_sr", "time_ratio", "rc", "ip")
"""Fields of a result that a list shows as they are."""
NEW_SCORES = ("place",)
"""Fields that results from before them lack, whose overviews stay as they are stored."""
EGO_FIELDS = ("id", "outcome", "ds", "rc", "ip", "ticks", "time_ratio")
FOR_ORGANISERS = ("thinking",)
"""Parts of the usage that no list shows to teams."""
MAX_INFRACTIONS = 10
"""Infractions of each CAV that an overview lists; the stored result has all."""
MAX_BYTES = 8 * 1024
"""Size limit of an overview [bytes]; larger ones list no infractions, and still larger ones no usage."""
MAX_RESULT_BYTES = 512 * 1024
"""Size limit of a stored result [bytes]."""


EMPTY_OVERVIEW: dict[str, Any] = {**dict.fromkeys(SCORES), "egos": None, "usage": None}
"""Of a job without a result."""


def make_overview(result: Mapping[str, Any], usage: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the overview of a result."""
    shown = {name: value for name, value in usage.items() if name not in FOR_ORGANISERS} if usage is not None else None
    overview = EMPTY_OVERVIEW | {name: result.get(name) for name in SCORES} | {"usage": shown}
    overview |= {name: result[name] for name in NEW_SCORES if name in result}
    if "egos" in result:
        overview["egos"] = [_describe_ego(ego, MAX_INFRACTIONS) for ego in result["egos"]]
    if count_bytes(overview) > MAX_BYTES and overview["egos"] is not None:
        overview["egos"] = [_describe_ego(ego, 0) for ego in result["egos"]]
    if count_bytes(overview) > MAX_BYTES:
        overview["usage"] = None
    return overview


def count_bytes(data: object) -> int:
    """Return the size of plain values as JSON [bytes]."""
    return len(json.dumps(data, separators=(",", ":")).encode())


def _describe_ego(ego: Mapping[str, Any], most: int) -> dict[str, Any]:
    listed = list(ego.get("infractions", ()))
    fields = {name: ego.get(name) for name in EGO_FIELDS}
    return fields | {"infractions": listed[:most], "infractions_left_out": max(0, len(listed) - most)}
