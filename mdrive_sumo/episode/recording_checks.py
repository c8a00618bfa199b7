"""Check that the parts of a recording from strangers fit together, before it is scored, drawn or replayed."""

import json
from typing import Any

import numpy as np
from pydantic import ValidationError

from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.state import End, Kind
from mdrive_sumo.episode.array_archive import Arrays, check_shapes
from mdrive_sumo.episode.episode_schema import NO_LINK, OF_RADIO, EpisodeHeader
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.v2x.channel import DeliveryStatus
from mdrive_sumo.v2x.radio.path_loss import LinkClass

MAX_TICK = 2**31
"""Ticks are summed as int64 and shown as times: none of a recording comes near it."""
MAX_INTERVAL_S = 1e6
"""Beyond any plan: what draws and scores plans multiplies by it."""
MAX_NAME = 1000
"""Characters of an id."""


def parse_header(header: dict[str, Any]) -> EpisodeHeader:
    """Return the checked header. Raises ValueError."""
    try:
        return EpisodeHeader.model_validate_json(json.dumps(header), strict=True)
    except ValidationError as error:
        raise ValueError(f"header: {describe_first_error(error)}") from None


def check_recording(header: EpisodeHeader, arrays: Arrays) -> None:
    """Raise ValueError unless the arrays have the sizes that the header announces, and all references exist."""
    if len(set(header.ids)) < len(header.ids) or not 0 <= header.egos <= len(header.ids):
        raise ValueError("header: ids and egos do not fit together")
    ticks = len(arrays["quanta"]) if "quanta" in arrays else 0
    sizes = {
        "T": ticks,
        "T8": -(-ticks // 8),
        "N": len(header.ids),
        "E": header.egos,
        "P": sum(plan.points for plan in header.plans),
        "B": sum(message.size for message in header.messages),
    }
    check_shapes(arrays, sizes)
    _check_counts(header)
    _check_references(header, arrays)


def _check_counts(header: EpisodeHeader) -> None:
    if any(plan.points < 0 for plan in header.plans) or any(message.size < 0 for message in header.messages):
        raise ValueError("header: a negative number of points or bytes")
    if any(not 0 < plan.interval_s < MAX_INTERVAL_S for plan in header.plans):
        raise ValueError(f"header: the time between points of a plan is not between 0 and {MAX_INTERVAL_S} s")
    if any(len(name) > MAX_NAME or clean_line(name) != name for name in (header.scenario, *header.ids)):
        raise ValueError(f"header: an id that is no line of text of at most {MAX_NAME} characters")
    entries = (*header.contacts, *header.signals, *header.plans, *header.messages, *header.notes, *header.endings)
    if any(abs(one.tick) > MAX_TICK for one in entries):
        raise ValueError(f"header: a tick beyond {MAX_TICK}")
    egos = {*header.ids[: header.egos]}
    named = {one.ego for one in (*header.contacts, *header.plans, *header.notes, *header.endings)}
    if not named <= egos:
        raise ValueError(f"header: no CAV {sorted(named - egos)[0][:60]!r}")
    if any((one.end is End.AGENT_FAILED) != (one.failed_tick is not None) for one in header.endings):
        raise ValueError("header: an agent that failed in no tick, or in one without having failed")


def _check_references(header: EpisodeHeader, arrays: Arrays) -> None:
    kinds = {int(kind) for kind in Kind}
    if not {*arrays["kind"].tolist(), *(contact.kind for contact in header.contacts)} <= kinds:
        raise ValueError("an unknown kind of road user")
    sizes = np.concatenate((arrays["length"], arrays["width"]))
    if not (np.isfinite(sizes) & (sizes >= 0)).all():
        raise ValueError("a length or width that is no size")
    rows = np.cumsum(arrays["fates"], axis=0, dtype=np.int64)
    ends = (len(header.messages), len(header.receivers), len(DeliveryStatus), MAX_TICK)
    if ((rows < (0, 0, 0, -MAX_TICK)) | (rows >= ends)).any():
        raise ValueError("fates: an index that does not exist")
    if OF_RADIO & set(arrays):
        _check_radio(header, arrays)


def _check_radio(header: EpisodeHeader, arrays: Arrays) -> None:
    if not set(arrays) >= OF_RADIO or len(arrays["links"]) != len(arrays["fates"]):
        raise ValueError("links and busy_ratios: expected both, and a link for each delivery")
    if not {*arrays["links"][:, 0].tolist()} <= {NO_LINK, *map(int, LinkClass)}:
        raise ValueError("links: an unknown class")
    rows = np.cumsum(arrays["busy_ratios"], axis=0, dtype=np.int64)
    if ((rows < (-MAX_TICK, 0, 0)) | (rows >= (MAX_TICK, len(header.stations), 1001))).any():
        raise ValueError("busy_ratios: an index that does not exist, or a ratio above 1")
