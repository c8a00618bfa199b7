"""V2X messages for the replay page: every message with its deliveries, and the contents that the page can show.

Contents are as sent: under a pose error a receiver got them shifted. Rows are sorted by (type, sender, tick), because
successive messages of a sender differ little and then compress well.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.v2x.channel import NOT_TRANSMITTED, DeliveryStatus, SentMessage
from mdrive_sumo.v2x.messages import (
    Cam,
    Content,
    Cpm,
    Denm,
    Feature,
    Mcm,
    MessageError,
    Termination,
    decode,
    find_problem,
)
from mdrive_sumo.v2x.radio.path_loss import LINK_NAMES, LinkClass

SHOWN_EVERY_TICKS = 4
"""Objects of CPMs and trajectories of MCMs are included at 5 Hz at most, to limit the size of the page."""
POINTS_EVERY = 2
"""Of a trajectory every second point and the last one are included."""
FATES = tuple(DeliveryStatus)
Tables: TypeAlias = dict[str, Int]


@dataclass(frozen=True, slots=True)
class _MessageRow:
    """A message and its row in the table of messages."""

    row: int
    message: Message
    content: Content | None
    """None for a type of the agents' own, or a malformed message."""
    shown: bool
    """Whether its objects or trajectories are included."""
    is_dropped: bool
    """Whether the recording was made without its content."""


def build_message_tables(episode: EpisodeRecord, scenario: Scenario, origin: Float) -> tuple[dict[str, Any], Tables]:
    """Return header entries and integer tables (columns, rows); positions in cm from the origin [m]."""
    sent = sorted(
        episode.messages,
        key=lambda sent_message: (sent_message.message.type, sent_message.message.sender, sent_message.message.tick),
    )
    stations = _list_stations(episode, scenario)
    column = {station: i for i, station in enumerate(stations)}
    types = sorted({sent_message.message.type for sent_message in sent})
    rows = list(_list_rows(episode, sent))
    mcms = [row for row in rows if isinstance(row.content, Mcm)]
    terms, term_of = _number_terms(mcms)
    places = {rsu.id: _to_cm((rsu.x, rsu.y), origin) for rsu in scenario.rsus}
    header = {
        "stations": stations,
        "station_places": [places.get(station) for station in stations],
        "types": types,
        "fates": [str(fate) for fate in FATES],
        "not_transmitted": sorted(NOT_TRANSMITTED),
        "link_classes": [LINK_NAMES[link_class] for link_class in LinkClass],
        "terms": terms,
        "problems": _list_problems(rows),
        "texts": _list_texts(rows),
    }
    heads = [(types.index(m.type), column[m.sender], m.tick, len(m.payload)) for m in (row.message for row in rows)]
    objects, tracks = _tabulate_objects(rows, origin)
    header["tracks"] = tracks
    return header, {
        "messages": _make_table(heads, 4),
        "fates": _make_table(_list_fates(sent, column), 4),
        "links": _make_table(_list_links(sent, column), 4),
        "cams": _make_table(
            (_encode_cam(row.row, row.content, origin) for row in rows if isinstance(row.content, Cam)), 9
        ),
        "cpms": _make_table((_encode_cpm(row, row.content) for row in rows if isinstance(row.content, Cpm)), 5),
        "cpm_objects": objects,
        "mcms": _make_table((_encode_mcm(row, term_of[row.row]) for row in mcms), 9),
        "mcm_points": _tabulate_points(mcms, origin),
    }


def _list_problems(rows: Sequence[_MessageRow]) -> list[tuple[int, str]]:
    """Return by row what is wrong with malformed messages."""
    known = ((row.row, find_problem(row.message)) for row in rows if not row.is_dropped)
    return [(row, problem) for row, problem in known if problem is not None]


def _list_texts(rows: Sequence[_MessageRow]) -> list[tuple[int, str]]:
    """Return by row what was sent in words, what warnings (DENMs) say, and what features are."""
    texts: list[tuple[int, str]] = []
    for row in rows:
        if row.is_dropped:
            texts.append((row.row, "content not recorded (--no-record-features)"))
        match row.content:
            case str() as text:
                texts.append((row.row, text))
            case Denm() as denm:
                texts.append((row.row, describe_event(denm)))
            case Feature() as feature:
                texts.append((row.row, describe_tiles(feature)))
            case _:
                pass
    return texts


def describe_event(denm: Denm) -> str:
    """Return a warning in words: "event 2, dangerous situation, at (12.3, 4.5), cancelled"."""
    words = denm.cause.name.lower().replace("_", " ")
    end = ", cancelled" if denm.termination is not Termination.NONE else f", valid for {denm.validity_s:g} s"
    return f"event {denm.sequence}, {words}, at ({denm.x:.1f}, {denm.y:.1f}){end}"


def describe_tiles(feature: Feature) -> str:
    """Return a packet of features in words: "12 tiles of bev-a version 3, confidence 0.98 to 0.71"."""
    grid, confidence = feature.grid, feature.confidence
    range_text = f", confidence {confidence.max():.2f} to {confidence.min():.2f}" if len(confidence) else ""
    return f"{len(feature.tiles)} tiles of {grid.name} version {grid.version}{range_text}"


def _list_links(sent: Sequence[SentMessage], column: Mapping[str, int]) -> list[tuple[int, int, int, int]]:
    """Return row, receiver, class and power [dBm] of the radio links; none where the channel is no radio."""
    return [
        (row, column[receiver], int(link.link_class), link.power_dbm)
        for row, sent_message in enumerate(sent)
        for receiver, link in sent_message.links.items()
        if receiver in column
    ]


def _list_fates(sent: Sequence[SentMessage], column: Mapping[str, int]) -> Iterator[tuple[int, int, int, int]]:
    """Yield row, column of the receiver, fate and its tick of every delivery."""
    for row, sent_message in enumerate(sent):
        for receiver, (fate, tick) in sent_message.deliveries.items():
            if receiver in column:
                yield row, column[receiver], FATES.index(fate), tick


def _list_stations(episode: EpisodeRecord, scenario: Scenario) -> list[str]:
    """Return the ids of all senders: CAVs in the order of their columns, then RSUs, then others."""
    stations = [*episode.ego_ids, *(rsu.id for rsu in scenario.rsus)]
    return [*stations, *sorted({sent.message.sender for sent in episode.messages} - set(stations))]


def _list_rows(episode: EpisodeRecord, sent: Sequence[SentMessage]) -> Iterator[_MessageRow]:
    last: dict[tuple[str, str], int] = {}
    for row, one in enumerate(sent):
        message = one.message
        source = message.sender, message.type
        shown = message.tick - last.get(source, -SHOWN_EVERY_TICKS) >= SHOWN_EVERY_TICKS
        if shown:
            last[source] = message.tick
        is_dropped = episode.is_payload_dropped(one)
        yield _MessageRow(row, message, None if is_dropped else _decode(episode, message), shown, is_dropped)


def _decode(episode: EpisodeRecord, message: Message) -> Content | None:
    """Return the content with the scenario's ids of stations; None if it cannot be decoded."""
    try:
        content = decode(message)
    except MessageError:
        return None
    if isinstance(content, str):
        return episode.restore_names(content)
    return _restore_stations(episode, message.sender, content) if isinstance(content, Mcm) else content


def _restore_stations(episode: EpisodeRecord, sender: str, mcm: Mcm) -> Mcm:
    """Return the MCM with the scenario's ids; its group is sorted unless it is the order of passing (`Mcm.answers`)."""
    rename = episode.restore_name
    answers = {rename(station): accepted for station, accepted in mcm.answers.items()}
    group = tuple(map(rename, mcm.group))
    return replace(
        mcm,
        requests={rename(station): requested for station, requested in mcm.requests.items()},
        answers=answers,
        group=group if answers.get(sender) else tuple(sorted(group)),
    )


def _make_table(rows: Any, columns: int) -> Int:
    """Return rows as an array (columns, rows)."""
    return np.array(list(rows), dtype=np.int64).reshape(-1, columns).T


def _to_cm(xy: Any, origin: Float) -> list[int]:
    return np.rint((np.asarray(xy) - origin) * 100).astype(np.int64).tolist()


def _encode_cam(row: int, cam: Cam, origin: Float) -> tuple[int, ...]:
    """Return row, x, y [cm], yaw [0.1 mrad], speed [cm/s], acceleration [cm/s2], yaw rate [mrad/s], length, width."""
    moving = round(cam.speed * 100), round(cam.acceleration * 100), round(cam.yaw_rate * 1000)
    x, y = _to_cm((cam.pose.x, cam.pose.y), origin)
    return row, x, y, round(cam.pose.yaw * 10_000), *moving, round(cam.length * 100), round(cam.width * 100)


def _encode_cpm(row: _MessageRow, cpm: Cpm) -> tuple[int, ...]:
    """Return row, range [dm], objects, sectors of free sight, whether its objects are included."""
    return row.row, round(cpm.range_m * 10), len(cpm.objects.ids), len(cpm.objects.free_m), row.shown


def _tabulate_objects(rows: Sequence[_MessageRow], origin: Float) -> tuple[Int, list[str]]:
    """Return (10, K), sorted by track, and the names of the tracks.

    Rows: message, track, kind, x, y [cm], yaw [0.1 mrad], speed [cm/s], length, width [cm], age [ticks].
    """
    names: dict[tuple[str, str], int] = {}
    parts = [np.zeros((10, 0), dtype=np.int64)]
    for row in rows:
        if not (row.shown and isinstance(row.content, Cpm)):
            continue
        seen = row.content.objects
        track = [names.setdefault((row.message.sender, name), len(names)) for name in seen.ids]
        fine = np.stack((seen.x - origin[0], seen.y - origin[1], seen.yaw * 100, seen.speed, seen.length, seen.width))
        x, y, *others = np.rint(fine * 100).astype(np.int64)
        at_row = np.full(len(track), row.row)
        parts.append(np.stack((at_row, np.array(track, dtype=np.int64), seen.kind, x, y, *others, row.content.age)))
    table = np.concatenate(parts, axis=1)
    return table[:, np.lexsort((table[0], table[1]))], [name for _, name in names]


def _number_terms(mcms: Sequence[_MessageRow]) -> tuple[list[Any], Mapping[int, int]]:
    """Return the distinct terms (requests, answers, group, time), and the index of the terms of each row."""
    number_by_term: dict[tuple[Any, ...], int] = {}
    term_of: dict[int, int] = {}
    for row in mcms:
        mcm = row.content
        assert isinstance(mcm, Mcm), "expected MCMs only"
        asked = tuple((who, what.name) for who, what in sorted(mcm.requests.items()))
        key = asked, tuple(sorted(mcm.answers.items())), mcm.group, mcm.until_tick
        term_of[row.row] = number_by_term.setdefault(key, len(number_by_term))
    return list(number_by_term), term_of


def _encode_mcm(row: _MessageRow, term: int) -> tuple[int, ...]:
    """Return row, speed [cm/s], yaw [0.1 mrad], intention, direction, term, interval [10 ms], counts of points."""
    mcm = row.content
    assert isinstance(mcm, Mcm), "expected MCMs only"
    counts = [len(_thin(line)) if row.shown else 0 for line in (mcm.planned, mcm.desired)]
    said = int(mcm.intention), int(mcm.direction), term, round(mcm.interval_s * 100)
    return row.row, round(mcm.speed * 100), round(mcm.pose.yaw * 10_000), *said, *counts


def _tabulate_points(mcms: Sequence[_MessageRow], origin: Float) -> Int:
    """Return (2, K): planned, then desired points of all MCMs [cm]."""
    kept = [row.content for row in mcms if row.shown and isinstance(row.content, Mcm)]
    lines = [_thin(line) for mcm in kept for line in (mcm.planned, mcm.desired)]
    return np.rint((np.concatenate([np.zeros((0, 2)), *lines]) - origin) * 100).astype(np.int64).T


def _thin(line: Float) -> Float:
    return np.concatenate((line[:-1:POINTS_EVERY], line[-1:]))
