"""Consistent agreements: how often all members of a group hold the same order of passing, and each can keep to it.

Read from recordings: notes say what was asked, and MCMs what each member answered.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.core.statistics import ConfidenceInterval, Label, bootstrap_nested
from mdrive_sumo.core.tables import Cell, Column, IntervalStyle, Row, Table, make_row, make_text_columns
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.export_run import load_recordings, select_recorded
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.v2x.messages import MCM, TEXT, Mcm, MessageError, decode

OUTCOME, FALLBACK = "negotiation", "llm-fallback"
"""Kinds of notes of negotiators."""
ANSWER_TICKS = TICKS_PER_SECOND
"""By then each member has sent its answer five times: it plans every 4 ticks, and a channel takes a few."""
BACKGROUND_WITHIN_M = 50.0
"""Of the most central member: as far as its network is told of traffic."""
MANY_PARTIES, MANY_VEHICLES = 5, 20
"""From so many parties on, and above so many vehicles, agreements are one row."""


@dataclass(frozen=True, slots=True)
class MeasuredAgreement:
    """What a conversation ended with."""

    tick: int
    source: str
    """The CAV that asked all others."""
    group: tuple[str, ...]
    order: tuple[str, ...]
    """(): there is none, by the rule or by an endpoint."""
    rounds: int
    has_refusal: bool
    """Whether a member refused, and all were asked again."""
    background: int
    """Vehicles that are no CAVs within `BACKGROUND_WITHIN_M`."""
    held_by: tuple[str, ...]
    """Members that hold it `ANSWER_TICKS` later; the source does."""

    @property
    def is_consistent(self) -> bool:
        """Whether all members hold the same order and say that they can keep to it."""
        return bool(self.order) and set(self.held_by) == set(self.group)


def list_agreements(episode: EpisodeRecord) -> list[MeasuredAgreement]:
    """Return the agreements of an episode in their order, without those that a member did not live to answer."""
    mcms = _list_mcms(episode)
    agreements: list[MeasuredAgreement] = []
    for tick, source, rounds, outcome in _list_outcomes(episode):
        group = tuple(sorted(episode.restore_name(name) for name in outcome["group"]))
        if not set(group) <= set(episode.ego_ids):
            continue
        if any(episode.find_ending(name).tick < tick + ANSWER_TICKS for name in group):
            continue
        order = tuple(episode.restore_name(name) for name in outcome.get("order", ()))
        held_by = [name for name in group if name == source or _holds(mcms[name], tick, source, order)]
        agreements.append(
            MeasuredAgreement(
                tick=tick,
                source=source,
                group=group,
                order=order,
                rounds=rounds,
                has_refusal=outcome["by"] == "refusal",
                background=_count_background(episode, tick, source),
                held_by=tuple(held_by),
            )
        )
    return agreements


def _list_outcomes(episode: EpisodeRecord) -> Iterator[tuple[int, str, int, Mapping[str, Any]]]:
    """Yield tick, source, rounds and contents of the last note of each conversation."""
    last: dict[tuple[str, tuple[str, ...]], tuple[int, str, int, Mapping[str, Any]]] = {}
    for record in episode.notes:
        if record.note.kind != OUTCOME:
            continue
        outcome = _read_outcome(record.note.text)
        if outcome is None:
            continue
        key = record.ego, tuple(sorted(outcome["group"]))
        if outcome.get("round") == 1 and key in last:
            yield last.pop(key)
        rounds = outcome["round"] if "round" in outcome else last[key][2] if key in last else 1
        last[key] = record.tick, record.ego, rounds, outcome
    yield from sorted(last.values(), key=lambda entry: entry[:2])


def _read_outcome(text: str) -> Mapping[str, Any] | None:
    """Return the contents of a note; None for one of another kind of negotiator."""
    try:
        outcome = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(outcome, dict) or type(outcome.get("round", 1)) is not int or "by" not in outcome:
        return None
    return outcome if _are_names(outcome.get("group")) and _are_names(outcome.get("order", [])) else None


def _are_names(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)


@dataclass(frozen=True, slots=True)
class _Answer:
    """The part of an MCM that answers, in the scenario's ids."""

    answers: Mapping[str, bool]
    group: tuple[str, ...]


def _list_mcms(episode: EpisodeRecord) -> dict[str, list[tuple[int, _Answer]]]:
    """Return tick and answers of the MCMs that each CAV sent."""
    mcms: dict[str, list[tuple[int, _Answer]]] = {name: [] for name in episode.ego_ids}
    for sent in episode.messages:
        if sent.message.type != MCM or sent.message.sender not in mcms or episode.is_payload_dropped(sent):
            continue
        try:
            content = decode(sent.message)
        except MessageError:
            continue
        if isinstance(content, Mcm):
            rename = episode.restore_name
            answers = {rename(name): yes for name, yes in content.answers.items()}
            group = tuple(map(rename, content.group))
            mcms[sent.message.sender].append((sent.message.tick, _Answer(answers, group)))
    return mcms


def _holds(mcms: Sequence[tuple[int, _Answer]], tick: int, source: str, order: tuple[str, ...]) -> bool:
    """Return whether the last MCM until the answer is due accepts the request of the source, with that order."""
    in_time = [mcm for sent, mcm in mcms if tick < sent <= tick + ANSWER_TICKS]
    return bool(in_time) and in_time[-1].answers.get(source) is True and in_time[-1].group == order


def _count_background(episode: EpisodeRecord, tick: int, source: str) -> int:
    column = episode.ego_ids.index(source)
    x, y = episode.x[tick], episode.y[tick]
    near = portable.hypot(x - x[column], y - y[column]) <= BACKGROUND_WITHIN_M
    is_background = (episode.kind == Kind.VEHICLE) & (np.arange(len(episode.ids)) >= episode.egos)
    return int((near & is_background & episode.valid[tick]).sum())


@dataclass(frozen=True, slots=True)
class RunAgreements:
    """The agreements of a run."""

    name: str
    agreements: tuple[MeasuredAgreement, ...]
    labels: tuple[Label, ...]
    """Place, scenario and number of each, for intervals."""
    message_bytes: tuple[int, ...]
    """Of all text messages."""
    fallbacks: int
    """Times that the rule stood in for the model."""


def measure_agreements(
    runs: Sequence[tuple[Path, StoredRun]], patterns: Sequence[str], announce: Callable[[str], None]
) -> list[RunAgreements]:
    """Return the agreements of every run. patterns: scenarios to take, none for all; announce: is told what is done.

    Raises InputError for a run without recordings or without a conversation.
    """
    measured: list[RunAgreements] = []
    for folder, stored in runs:
        name = f"{stored.results.run.agent}, {stored.results.run.comm.get('preset', 'ideal')} ({folder.name})"
        agreements: list[MeasuredAgreement] = []
        labels: list[Label] = []
        sizes: list[int] = []
        fallbacks, numbers = 0, count()
        for recording in load_recordings(stored, select_recorded(stored, patterns)):
            found = list_agreements(recording.record)
            agreements += found
            labels += [(recording.scenario.network, recording.name, next(numbers)) for _ in found]
            sizes += [len(sent.message.payload) for sent in recording.record.messages if sent.message.type == TEXT]
            fallbacks += sum(record.note.kind == FALLBACK for record in recording.record.notes)
            announce(f"{name}: {recording.name}")
        if not agreements:
            raise InputError(f"{folder}: expected conversations that ended with an agreement, found none")
        measured.append(RunAgreements(name, tuple(agreements), tuple(labels), tuple(sizes), fallbacks))
    return measured


def build_agreement_table(measured: Sequence[RunAgreements]) -> Table:
    """Return a row for each run, number of parties and density of the background."""
    columns = (
        *make_text_columns({"run": "run", "which": "agreements"}),
        Column("number", "number", decimals=0),
        Column("consistent", "consistent %", decimals=1, intervals=IntervalStyle.ENDS),
        Column("ordered", "with an order %", decimals=1),
        Column("refused", "refused %", decimals=1),
        Column("rounds", "rounds"),
        Column("bytes", "bytes a message", decimals=0),
        Column("most_bytes", "at most", decimals=0),
        Column("fallbacks", "fallbacks", decimals=0),
    )
    rows = [row for run in measured for row in _list_rows(run)]
    return Table("agreements", "Consistent agreements", columns, tuple(rows), left=2)


def _list_rows(run: RunAgreements) -> Iterator[Row]:
    talk = (
        sum(run.message_bytes) / len(run.message_bytes) if run.message_bytes else None,
        max(run.message_bytes, default=None),
        run.fallbacks,
    )
    everything = range(len(run.agreements))
    yield make_row((run.name, "all", *_summarise(run, everything), *talk))
    for classify in (_name_parties, _name_background):
        names = [classify(agreement) for agreement in run.agreements]
        for name in sorted(set(names)):
            chosen = [i for i in everything if names[i] == name]
            yield make_row((run.name, name, *_summarise(run, chosen), None, None, None))


def _summarise(run: RunAgreements, rows: Sequence[int]) -> tuple[Cell, ...]:
    chosen = [run.agreements[i] for i in rows]
    consistent = _interval([agreement.is_consistent for agreement in chosen], [run.labels[i] for i in rows])
    return (
        Cell(len(chosen)),
        Cell(consistent.mean, consistent),
        Cell(100 * sum(bool(agreement.order) for agreement in chosen) / len(chosen)),
        Cell(100 * sum(agreement.has_refusal for agreement in chosen) / len(chosen)),
        Cell(sum(agreement.rounds for agreement in chosen) / len(chosen)),
    )


def _interval(values: Sequence[bool], labels: Sequence[Label]) -> ConfidenceInterval:
    return bootstrap_nested([100.0 * value for value in values], labels)


def _name_parties(agreement: MeasuredAgreement) -> str:
    parties = len(agreement.group)
    return f"{parties} parties" if parties < MANY_PARTIES else f"{MANY_PARTIES} parties or more"


def _name_background(agreement: MeasuredAgreement) -> str:
    if agreement.background == 0:
        return "alone on the road"
    return f"1 to {MANY_VEHICLES} vehicles" if agreement.background <= MANY_VEHICLES else f"more than {MANY_VEHICLES}"
