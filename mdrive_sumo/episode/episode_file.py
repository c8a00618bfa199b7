"""Load and save recordings: one .npz without pickles, with a JSON header and integer arrays (see `episode_schema`)."""

import json
import zipfile
import zlib
from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import new_file
from mdrive_sumo.core.state import Contact, Kind
from mdrive_sumo.episode.array_archive import Arrays, read_arrays
from mdrive_sumo.episode.episode import Ending, EpisodeRecord, NoteRecord, PlanRecord
from mdrive_sumo.episode.episode_schema import FORMAT, NO_LINK, EpisodeHeader
from mdrive_sumo.episode.recording_checks import check_recording, parse_header
from mdrive_sumo.scenario.scenario import shorten_value
from mdrive_sumo.v2x.channel import Delivery, DeliveryStatus, SentMessage
from mdrive_sumo.v2x.message_counts import is_malformed
from mdrive_sumo.v2x.radio.path_loss import LinkClass
from mdrive_sumo.v2x.radio.radio_medium import AirLink, BusyRatio

_CORRUPT = (
    OSError, ValueError, KeyError, TypeError, EOFError, IndexError, RuntimeError, NotImplementedError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What zipfile and the checks raise for damaged files; RuntimeError for bytes that look like an encrypted member."""
_FATES = tuple(DeliveryStatus)
Ints = npt.NDArray[np.signedinteger[Any]]


def save_episode(episode: EpisodeRecord, path: Path) -> None:
    """Write the file atomically (a new file is renamed)."""
    header = {
        "format": FORMAT,
        "scenario": episode.scenario,
        "about": dict(episode.about),
        "ids": episode.ids,
        "egos": episode.egos,
        "contacts": [(tick, c.ego, c.other, int(c.kind)) for tick, c in episode.contacts],
        "signals": episode.signals,
        "endings": [asdict(ending) for ending in episode.endings],
        "plans": [(p.tick, p.ego, p.interval_s, len(p.points)) for p in episode.plans],
        "messages": [(m.sender, m.tick, m.type, len(m.payload)) for m in (sent.message for sent in episode.messages)],
        "receivers": _list_receivers(episode.messages),
        **({"stations": _list_stations(episode)} if episode.busy_ratios else {}),
        "notes": [(n.tick, n.ego, n.note.kind, n.note.text) for n in episode.notes],
        **({"dropped_notes": episode.dropped_notes} if episode.dropped_notes else {}),
        **({"dropped_payloads": episode.dropped_payloads} if episode.dropped_payloads else {}),
        "thinking": episode.thinking,
        "pseudonyms": dict(episode.pseudonyms),
    }
    arrays = {
        "header": np.frombuffer(json.dumps(header, separators=(",", ":")).encode(), dtype=np.uint8),
        "kind": episode.kind,
        "length": episode.length,
        "width": episode.width,
        "valid": np.packbits(episode.valid, axis=0),
        "quanta": _compute_second_differences(episode.quanta, episode.valid),
        "controls": _to_narrowest(np.diff(episode.controls, axis=0, prepend=np.int16(0)).astype(np.int32)),
        "plan_points": _to_narrowest(_compute_point_differences(episode.plans)),
        "payloads": np.frombuffer(b"".join(sent.message.payload for sent in episode.messages), dtype=np.uint8),
        "fates": _compute_differences(_fates(episode.messages)),
        "digests": episode.digests,
        **(_pack_radio(episode) if episode.busy_ratios else {}),
    }
    with new_file(path) as file:
        np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]


def drop_payloads(episode: EpisodeRecord, types: Collection[str]) -> EpisodeRecord:
    """Return the recording with zeros instead of the valid payloads of these types of messages.

    Sizes stay, and so do digests, scores and what became of each message.
    """
    messages = tuple(
        replace(sent, message=replace(sent.message, payload=bytes(len(sent.message.payload))))
        if sent.message.type in types and not is_malformed(sent)
        else sent
        for sent in episode.messages
    )
    dropped = {sent.message.type for sent in episode.messages}.intersection(types)
    return replace(episode, messages=messages, dropped_payloads=tuple(sorted(dropped)))


def load_episode(path: Path) -> EpisodeRecord:
    """Load an episode file. Raises InputError for one that is missing, corrupt or of another version."""
    try:
        arrays = read_arrays(path)
        stated = json.loads(arrays["header"].tobytes())
        if stated["format"] != FORMAT:
            raise InputError(f"{path}: expected the format {FORMAT}, found {shorten_value(stated['format'])}")
        header = parse_header(stated)
        check_recording(header, arrays)
        return _build_record(header, arrays)
    except FileNotFoundError:
        raise InputError(f"{path}: expected a recording, found no file") from None
    except _CORRUPT as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: expected a recording of mdrive-sumo, found a corrupt file ({reason})") from None


def _build_record(header: EpisodeHeader, data: Arrays) -> EpisodeRecord:
    ticks = len(data["quanta"])
    valid = np.unpackbits(data["valid"], axis=0, count=ticks).astype(np.bool_)
    plans, begin = [], 0
    for tick, ego, interval_s, count in header.plans:
        points = np.cumsum(data["plan_points"][begin : begin + count].astype(np.int32), axis=0) / 100
        plans.append(PlanRecord(tick, ego, interval_s, points))
        begin += count
    return EpisodeRecord(
        scenario=header.scenario,
        about=header.about,
        ids=tuple(header.ids),
        egos=header.egos,
        kind=data["kind"],
        length=data["length"],
        width=data["width"],
        valid=valid,
        quanta=_integrate_twice(data["quanta"], valid),
        controls=np.cumsum(data["controls"], axis=0, dtype=np.int32).astype(np.int16),
        plans=tuple(plans),
        contacts=tuple((tick, Contact(ego, other, Kind(kind))) for tick, ego, other, kind in header.contacts),
        signals=tuple(header.signals),
        endings=tuple(Ending(**dict(ending)) for ending in header.endings),
        digests=data["digests"],
        messages=_build_messages(header, data),
        busy_ratios=_build_busy_ratios(header, data),
        notes=tuple(NoteRecord(tick, ego, Note(kind, text)) for tick, ego, kind, text in header.notes),
        dropped_notes=header.dropped_notes,
        dropped_payloads=tuple(header.dropped_payloads),
        thinking=tuple(header.thinking),
        pseudonyms=header.pseudonyms,
    )


def _list_receivers(messages: Sequence[SentMessage]) -> list[str]:
    return sorted({receiver for sent in messages for receiver in sent.deliveries})


def _fates(messages: Sequence[SentMessage]) -> npt.NDArray[np.int32]:
    """(F, 4): index of the message, index of the receiver, index of the fate, tick."""
    column = {name: i for i, name in enumerate(_list_receivers(messages))}
    rows = [
        (i, column[receiver], _FATES.index(fate), tick)
        for i, sent in enumerate(messages)
        for receiver, (fate, tick) in sent.deliveries.items()
    ]
    return np.array(rows, dtype=np.int32).reshape(-1, 4)


def _list_stations(episode: EpisodeRecord) -> list[str]:
    return sorted({station for _, station, _ in episode.busy_ratios})


def _pack_radio(episode: EpisodeRecord) -> dict[str, npt.NDArray[np.signedinteger[Any]]]:
    """Return the arrays of a radio: the links in the order of `_fates`, and the busy ratios."""
    column = {name: i for i, name in enumerate(_list_stations(episode))}
    links = [sent.links.get(receiver, (NO_LINK, 0)) for sent in episode.messages for receiver in sent.deliveries]
    ratios = [(tick, column[station], round(ratio * 1000)) for tick, station, ratio in episode.busy_ratios]
    return {
        "links": np.array(links, dtype=np.int16).reshape(-1, 2),
        "busy_ratios": _compute_differences(np.array(ratios, dtype=np.int32).reshape(-1, 3)),
    }


def _build_busy_ratios(header: EpisodeHeader, data: Arrays) -> tuple[BusyRatio, ...]:
    rows = np.cumsum(data["busy_ratios"], axis=0).tolist() if "busy_ratios" in data else []
    return tuple(BusyRatio(tick, header.stations[station], ratio / 1000) for tick, station, ratio in rows)


def _build_messages(header: EpisodeHeader, data: Arrays) -> tuple[SentMessage, ...]:
    fates: list[dict[str, Delivery]] = [{} for _ in header.messages]
    links: list[dict[str, AirLink]] = [{} for _ in header.messages]
    rows = np.cumsum(data["fates"], axis=0).tolist()
    for i, receiver, fate, tick in rows:
        fates[i][header.receivers[receiver]] = Delivery(_FATES[fate], tick)
    levels: list[list[int]] = data["links"].tolist() if "links" in data else []
    for (i, receiver, *_), (kind, power_dbm) in zip(rows, levels, strict=False):
        if kind != NO_LINK:
            links[i][header.receivers[receiver]] = AirLink(LinkClass(kind), power_dbm)
    payloads, begin, messages = data["payloads"].tobytes(), 0, list[SentMessage]()
    for (sender, tick, name, size), what, over in zip(header.messages, fates, links, strict=True):
        messages.append(SentMessage(Message(name, payloads[begin : begin + size], sender, tick), what, over))
        begin += size
    return tuple(messages)


def _compute_differences(values: Ints) -> Ints:
    """Return the first row, then the differences of successive rows (T, ...)."""
    return np.diff(values, axis=0, prepend=np.zeros_like(values[:1]))


def _compute_point_differences(plans: Sequence[PlanRecord]) -> Ints:
    """Return the points of all plans (P, 2) [cm]: of each plan the first, then differences of successive points."""
    if not plans:
        return np.zeros((0, 2), np.int32)
    points = np.rint(np.concatenate([plan.points for plan in plans]) * 100).astype(np.int32)
    starts = np.cumsum([0, *(len(plan.points) for plan in plans[:-1])])
    differences = _compute_differences(points)
    differences[starts] = points[starts]
    return differences


def _compute_second_differences(quanta: Ints, valid: npt.NDArray[np.bool_]) -> Ints:
    """Return second differences (T, N, 4), small for smooth motion; absent road users hold their last value."""
    ticks, columns = np.arange(len(valid))[:, None], np.arange(valid.shape[1])
    held = quanta[np.maximum.accumulate(np.where(valid, ticks, 0), axis=0), columns]
    return _to_narrowest(_compute_differences(_compute_differences(held)))


def _integrate_twice(stored: Ints, valid: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    held = np.cumsum(np.cumsum(stored, axis=0, dtype=np.int64), axis=0)
    return np.where(valid[..., None], held, 0).astype(np.int32)


def _to_narrowest(values: Ints) -> Ints:
    """Return the integers in the smallest signed type that holds them."""
    peak = int(np.abs(values).max(initial=0))
    return values.astype(np.int8 if peak < 2**7 else np.int16 if peak < 2**15 else np.int32)
