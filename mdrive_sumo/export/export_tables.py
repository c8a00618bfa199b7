"""The tables of the CSV and Parquet exports: columns with types, units and descriptions, and their rows."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.export.table_files import Columns, TableColumn, TableParts, write_csv_tables
from mdrive_sumo.scoring import EgoResult
from mdrive_sumo.v2x.radio.path_loss import LINK_NAMES
from mdrive_sumo.v2x.radio.radio_medium import AirLink


@dataclass(frozen=True, slots=True)
class ExportTable:
    """A table. Its first columns, scenario and seed, are added to those that `build` returns for a recording."""

    name: str
    description: str
    own_columns: tuple[TableColumn, ...]
    build: Callable[[ScoredRecording], Columns]

    @property
    def columns(self) -> tuple[TableColumn, ...]:
        """All columns."""
        return (*KEY_COLUMNS, *self.own_columns)

    def build_rows(self, recording: ScoredRecording) -> dict[str, Sequence[Any]]:
        """Return the values of all columns, in their order, for one recording."""
        own = self.build(recording)
        count = len(next(iter(own.values())))
        result = recording.result
        keys = {"scenario": [result.id] * count, "seed": [result.seed] * count}
        return {column.name: {**keys, **own}[column.name] for column in self.columns}


KEY_COLUMNS = (
    TableColumn("scenario", "string", "", "id of the scenario"),
    TableColumn("seed", "integer", "", "seed of the run"),
)
_TICK = TableColumn("tick", "integer", "tick", "20 per second, the first is 0")
_TIME = TableColumn("time_s", "number", "s", "time since the start of the episode")
_CAV = TableColumn("cav", "string", "", "id of the CAV")
_SCORES = (
    TableColumn("ds", "number", "%", "driving score"),
    TableColumn("rc", "number", "%", "route completion"),
    TableColumn("ip", "number", "", "infraction penalty, a factor in [0, 1]"),
    TableColumn("ticks", "integer", "tick", "length of the drive"),
    TableColumn("time_ratio", "number", "", "time needed / omniscient's time; empty unless every CAV arrived"),
)


def _build_states(recording: ScoredRecording) -> Columns:
    record = recording.record
    ticks, columns = np.nonzero(record.valid)
    names = [kind.name.lower() for kind in Kind]
    is_cav = columns < record.egos
    controls = record.control_values
    pedals = [
        [float(controls[t, c, i]) if own else None for t, c, own in zip(ticks, columns, is_cav, strict=True)]
        for i in range(3)
    ]
    decimals = {"x": 3, "y": 3, "yaw": 4, "speed": 3}  # the resolution of recordings
    return {
        "tick": ticks.tolist(),
        "time_s": np.round(ticks * DT, 2).tolist(),
        "id": [record.ids[column] for column in columns],
        "kind": [names[record.kind[column]] for column in columns],
        "is_cav": is_cav.tolist(),
        **{name: np.round(getattr(record, name)[ticks, columns], n).tolist() for name, n in decimals.items()},
        "length": record.length[columns].tolist(),
        "width": record.width[columns].tolist(),
        **dict(zip(("throttle", "brake", "steer"), pedals, strict=True)),
    }


def _build_messages(recording: ScoredRecording) -> Columns:
    rows = [
        (
            *(sent.message.tick, sent.message.sender, sent.message.type, len(sent.message.payload), receiver),
            *delivery,
            *_describe_link(sent.links.get(receiver)),
        )
        for sent in recording.record.messages
        for receiver, delivery in sent.deliveries.items()
    ]
    names = ("tick", "sender", "type", "bytes", "receiver", "delivery", "delivery_tick", "link_class", "power_dbm")
    columns = _transpose(rows, names)
    times = [round(tick * DT, 2) for tick in columns["tick"]]
    return {**columns, "time_s": times, "delivery": [str(status) for status in columns["delivery"]]}


def _describe_link(link: AirLink | None) -> tuple[str, int | None]:
    """Return the class of a radio link and the power that is received over it; empty where the channel is no radio."""
    return ("", None) if link is None else (LINK_NAMES[link.link_class], link.power_dbm)


def _build_events(recording: ScoredRecording) -> Columns:
    names = ("tick", "cav", "event", "other", "x", "y", "factor", "impact_speed", "text")
    rows = [
        (
            infraction.tick,
            ego.id,
            infraction.kind,
            infraction.other,
            infraction.x,
            infraction.y,
            infraction.factor,
            infraction.impact_speed,
            "",
        )
        for ego in recording.result.egos
        for infraction in ego.infractions
    ]
    record = recording.record
    for ending in record.endings:
        column = record.ego_ids.index(ending.ego)
        last = int(np.flatnonzero(record.valid[:, column])[-1])
        x, y = (round(float(values[last, column]), 3) for values in (record.x, record.y))
        reason = " ".join(filter(None, (ending.failure, record.restore_names(ending.text))))
        rows.append((ending.tick, ending.ego, str(ending.end), "", x, y, 1.0, None, reason))
    columns = _transpose(sorted(rows, key=lambda row: row[:3]), names)
    return {**columns, "time_s": [round(tick * DT, 2) for tick in columns["tick"]]}


def _build_signals(recording: ScoredRecording) -> Columns:
    rows = [(change.tick, change.light, change.state) for change in recording.record.signals]
    columns = _transpose(rows, ("tick", "light", "state"))
    return {**columns, "time_s": [round(tick * DT, 2) for tick in columns["tick"]]}


def _build_scores(recording: ScoredRecording) -> Columns:
    result = recording.result
    names = ("bucket", "category", "ds", "sr", "efficient_sr", "rc", "ip", "ticks", "time_ratio", "min_ttc", "digest")
    return {
        **{name: [getattr(result, name)] for name in names},
        "cavs": [len(result.egos)],
        "infractions": [sum(infraction.factor < 1.0 for ego in result.egos for infraction in ego.infractions)],
    }


def _build_cav_scores(recording: ScoredRecording) -> Columns:
    def count_infractions(ego: EgoResult) -> int:
        return sum(infraction.factor < 1.0 for infraction in ego.infractions)

    egos = recording.result.egos
    return {
        "cav": [ego.id for ego in egos],
        "outcome": [str(ego.outcome) for ego in egos],
        **{name: [getattr(ego, name) for ego in egos] for name in ("reason", "ds", "rc", "ip", "ticks", "time_ratio")},
        "infractions": [count_infractions(ego) for ego in egos],
        "speeding": [ego.speeding and ego.speeding.share for ego in egos],
        "speeding_greatest": [ego.speeding and ego.speeding.greatest for ego in egos],
    }


def _transpose(rows: Iterable[Sequence[Any]], names: Sequence[str]) -> dict[str, list[Any]]:
    """Return the values of each column."""
    table = list(rows)
    return {name: [row[i] for row in table] for i, name in enumerate(names)}


EXPORT_TABLES = (
    ExportTable(
        "states",
        "one row per tick and road user that is in the world; positions in the network's frame",
        (
            _TICK,
            _TIME,
            TableColumn("id", "string", "", "id of the road user or obstacle"),
            TableColumn("kind", "string", "", "vehicle, pedestrian, cyclist or static"),
            TableColumn("is_cav", "boolean", "", "whether an agent drives it"),
            TableColumn("x", "number", "m", "centre of the box, resolution 1 mm"),
            TableColumn("y", "number", "m", "centre of the box, resolution 1 mm"),
            TableColumn("yaw", "number", "rad", "counter-clockwise from +x, resolution 0.1 mrad"),
            TableColumn("speed", "number", "m/s", "along yaw, resolution 1 mm/s"),
            TableColumn("length", "number", "m", "length of the box"),
            TableColumn("width", "number", "m", "width of the box"),
            TableColumn("throttle", "number", "", "applied after this tick, in [0, 1]; empty unless a CAV"),
            TableColumn("brake", "number", "", "applied after this tick, in [0, 1]; empty unless a CAV"),
            TableColumn(
                "steer", "number", "", "applied after this tick, in [-1, 1], left positive; empty unless a CAV"
            ),
        ),
        _build_states,
    ),
    ExportTable(
        "messages",
        "one row per V2X message and receiver",
        (
            _TICK,
            _TIME,
            TableColumn("sender", "string", "", "id of the sending station"),
            TableColumn("type", "string", "", "type of the message, such as CAM"),
            TableColumn("bytes", "integer", "byte", "length of the payload, without the header"),
            TableColumn("receiver", "string", "", "id of the station that receives or should"),
            TableColumn("delivery", "string", "", "delivered, lost, out-of-range, ..."),
            TableColumn("delivery_tick", "integer", "tick", "tick of the arrival or loss"),
            TableColumn("link_class", "string", "", "LOS, NLOSv or NLOSb when it was sent; empty unless a radio"),
            TableColumn("power_dbm", "integer", "dBm", "received power when it was sent; empty unless a radio"),
        ),
        _build_messages,
    ),
    ExportTable(
        "events",
        "one row per infraction, and one per CAV for how it ended",
        (
            _TICK,
            _TIME,
            _CAV,
            TableColumn("event", "string", "", "kind of the infraction, or how the CAV ended"),
            TableColumn("other", "string", "", "id of what it concerns, empty where there is none"),
            TableColumn("x", "number", "m", "box centre of the CAV"),
            TableColumn("y", "number", "m", "box centre of the CAV"),
            TableColumn("factor", "number", "", "multiplies the infraction penalty; 1 costs nothing"),
            TableColumn("impact_speed", "number", "m/s", "relative speed of a collision, else empty"),
            TableColumn("text", "string", "", "why the agent failed, else empty"),
        ),
        _build_events,
    ),
    ExportTable(
        "signals",
        "one row per change of a traffic light",
        (
            _TICK,
            _TIME,
            TableColumn("light", "string", "", "id of the traffic light"),
            TableColumn("state", "string", "", "letters of SUMO, one per link, from this tick on"),
        ),
        _build_signals,
    ),
    ExportTable(
        "scores",
        "one row per episode, in the score mode of the run",
        (
            TableColumn("bucket", "string", "", "bucket of the scenario"),
            TableColumn("category", "string", "", "category of the scenario"),
            TableColumn("cavs", "integer", "", "number of CAVs"),
            TableColumn("sr", "number", "%", "success rate"),
            TableColumn("efficient_sr", "number", "%", "success rate within twice omniscient's time"),
            *_SCORES,
            TableColumn("min_ttc", "number", "s", "least time to contact; empty if never within 1.8 s"),
            TableColumn("infractions", "integer", "", "infractions that cost something"),
            TableColumn("digest", "string", "", "digest of the episode"),
        ),
        _build_scores,
    ),
    ExportTable(
        "cav_scores",
        "one row per CAV",
        (
            _CAV,
            TableColumn("outcome", "string", "", "arrived, blocked, deviated, timed-out or agent-failed"),
            TableColumn("reason", "string", "", "why the agent failed, else empty"),
            *_SCORES,
            TableColumn("infractions", "integer", "", "infractions that cost something"),
            TableColumn("speeding", "number", "%", "share of its time over 1.1 x the speed limit"),
            TableColumn("speeding_greatest", "number", "m/s", "greatest difference from the limit"),
        ),
        _build_cav_scores,
    ),
)
"""All tables, in the order of the documentation."""


def write_csv(recordings: Iterable[ScoredRecording], folder: Path) -> None:
    """Write one file per table with the rows of all recordings."""
    write_csv_tables(EXPORT_TABLES, map(build_parts, recordings), folder)


def build_parts(recording: ScoredRecording) -> TableParts:
    """Return the rows of one recording, by table."""
    return {table.name: table.build_rows(recording) for table in EXPORT_TABLES}
