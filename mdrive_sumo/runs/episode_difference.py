"""The first difference between a recorded episode and its second execution."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import DRIVER, REMARK
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.episode import EpisodeRecord, NoteRecord, drop_payloads
from mdrive_sumo.episode.quantization import Quanta, from_quanta
from mdrive_sumo.v2x.channel import DeliveryStatus

STATE_NAMES = ("x", "y", "yaw", "speed")
STATE_UNITS = ("m", "m", "rad", "m/s")
CONTROL_NAMES = ("throttle", "brake", "steer")


@dataclass(frozen=True, slots=True)
class EpisodeDifference:
    """The first tick in which two episodes differ, and one difference in it."""

    tick: int
    text: str


def find_first_difference(recorded: EpisodeRecord, again: EpisodeRecord) -> EpisodeDifference | None:
    """Return the first difference between two episodes; None if every tick and every ending is the same."""
    ticks = min(recorded.ticks, again.ticks)
    differing = np.flatnonzero((recorded.digests[:ticks] != again.digests[:ticks]).any(axis=1))
    if len(differing):
        tick = int(differing[0])
        return EpisodeDifference(tick, next(_find_details(recorded, again, tick), "the digest differs"))
    if recorded.ticks != again.ticks:
        return EpisodeDifference(ticks, f"the episode has {again.ticks} ticks, had {recorded.ticks}")
    for now, then in zip(again.endings, recorded.endings, strict=True):
        if (now.tick, now.end, now.failed_tick) != (then.tick, then.end, then.failed_tick):
            return EpisodeDifference(
                min(now.tick, then.tick),
                f"{now.ego!r} ends {now.end} in tick {now.tick}, ended {then.end} in tick {then.tick}",
            )
    return None


def find_parting(a: EpisodeRecord, b: EpisodeRecord) -> EpisodeDifference | None:
    """Return the first tick in which the CAVs of two episodes differ, and how one of them does; None if they never do.

    Other road users are not compared: they may differ earlier or later. Raises InputError unless both have the same
    CAVs.
    """
    here, there, states, others = _align_cavs(a, b)
    differing = (here != there) | (here & there & (states != others).any(axis=-1))
    rows = np.flatnonzero(differing.any(axis=1))
    if not len(rows):
        return None if a.ticks == b.ticks else EpisodeDifference(len(here), "one episode ends")
    tick = int(rows[0])
    column = int(np.flatnonzero(differing[tick])[0])
    if here[tick, column] != there[tick, column]:
        return EpisodeDifference(tick, f"CAV {a.ego_ids[column]} has ended in one of them")
    return EpisodeDifference(
        tick, f"CAV {a.ego_ids[column]} has {_compare_quanta(states[tick, column], others[tick, column])}"
    )


def find_separation(a: EpisodeRecord, b: EpisodeRecord, metres: float) -> EpisodeDifference | None:
    """Return the first tick in which a CAV is farther than `metres` from its place in the other episode, or None.

    Raises InputError unless both have the same CAVs.
    """
    here, there, states, others = _align_cavs(a, b)
    offsets = from_quanta(states)[..., :2] - from_quanta(others)[..., :2]
    distances = np.where(here & there, portable.hypot(offsets[..., 0], offsets[..., 1]), 0.0)
    rows = np.flatnonzero((distances > metres).any(axis=1))
    if not len(rows):
        return None
    column = int(distances[rows[0]].argmax())
    return EpisodeDifference(int(rows[0]), f"CAV {a.ego_ids[column]}")


def _align_cavs(a: EpisodeRecord, b: EpisodeRecord) -> tuple[Bool, Bool, Quanta, Quanta]:
    """Return presence (T, C) and states (T, C, 4) of the CAVs of both, in the order of `a`, as long as both go on."""
    if sorted(a.ego_ids) != sorted(b.ego_ids):
        raise InputError(
            f"recordings of {a.scenario}: expected two with the same CAVs, found {', '.join(a.ego_ids)} and"
            f" {', '.join(b.ego_ids)}"
        )
    ticks, columns = min(a.ticks, b.ticks), [b.ego_ids.index(ego) for ego in a.ego_ids]
    count = len(columns)
    return a.valid[:ticks, :count], b.valid[:ticks, columns], a.quanta[:ticks, :count], b.quanta[:ticks, columns]


def _compare_quanta(state: Quanta, other: Quanta) -> str:
    """Return the last of x, y, yaw and speed that differs, with both values."""
    i = int(np.flatnonzero(state != other)[-1])
    values = (f"{from_quanta(quanta)[i]:.3f}" for quanta in (state, other))
    return f"{STATE_NAMES[i]} {' and '.join(values)} {STATE_UNITS[i]}"


def find_content_difference(recorded: EpisodeRecord, again: EpisodeRecord) -> EpisodeDifference | None:
    """Return the first difference between episodes of equal digests; None if there is none.

    There is one in a recording whose content was changed and whose digests were left.
    """
    if recorded.dropped_payloads:
        again = drop_payloads(again, recorded.dropped_payloads)
    for name in ("ids", "egos", "kind", "length", "width", "pseudonyms", "signals", "contacts", "messages"):
        then, now = getattr(recorded, name), getattr(again, name)
        same = np.array_equal(then, now) if isinstance(now, np.ndarray) else then == now
        if not same:
            return EpisodeDifference(0, f"{name} of the recording are not those of the episode, its digests are")
    if recorded.sensing_track not in ("", again.sensing_track):
        text = f"sensing track {recorded.sensing_track} in the recording, {again.sensing_track} in the episode"
        return EpisodeDifference(0, text)
    marks = [[_mark_note(one) for one in episode.notes] for episode in (recorded, again)]
    if marks[0] != marks[1]:
        return EpisodeDifference(0, "notes of the recording are not those of the episode, its digests are")
    for tick in range(again.ticks):
        if detail := next(_find_details(recorded, again, tick), ""):
            return EpisodeDifference(tick, f"{detail}, although its digest is the same")
    return None


def _mark_note(one: NoteRecord) -> tuple[int, str, str, str]:
    """Return what must be the same of a note: of those of a person also the text, those of agents may hold times."""
    return one.tick, one.ego, one.note.kind, one.note.text if one.note.kind in (DRIVER, REMARK) else ""


def _find_details(recorded: EpisodeRecord, again: EpisodeRecord, tick: int) -> Iterator[str]:
    """Yield the differences of one tick: messages, road users, states, controls, signals, contacts."""
    if (heard := _read_arrivals(again, tick)) != (had := _read_arrivals(recorded, tick)):
        yield f"messages that arrive: {heard or 'none'}, were {had or 'none'}"
    yield from _compare_states(_read_states(recorded, tick), _read_states(again, tick))
    yield from _compare_controls(recorded, again, tick)
    if (lights := _read_signal_changes(again, tick)) != (before := _read_signal_changes(recorded, tick)):
        yield f"traffic lights change to {lights}, changed to {before}"
    if (touching := _read_contacts(again, tick)) != (touched := _read_contacts(recorded, tick)):
        yield f"contacts are {touching or 'none'}, were {touched or 'none'}"


def _compare_states(then: Mapping[str, Float], now: Mapping[str, Float]) -> Iterator[str]:
    for name in sorted({*then, *now}):
        if name not in now or name not in then:
            yield f"{name!r} is {'new' if name in now else 'missing'}"
            continue
        for i in np.flatnonzero(then[name] != now[name]):
            yield f"{STATE_NAMES[i]} of {name!r} is {now[name][i]:.4f}, was {then[name][i]:.4f}"


def _compare_controls(recorded: EpisodeRecord, again: EpisodeRecord, tick: int) -> Iterator[str]:
    then, now = recorded.control_values[tick], again.control_values[tick]
    for ego, i in np.argwhere(then != now):
        yield f"{CONTROL_NAMES[i]} of {again.ids[ego]!r} is {now[ego, i]:.4f}, was {then[ego, i]:.4f}"


def _read_states(episode: EpisodeRecord, tick: int) -> dict[str, Float]:
    """Return the state (4,) of every present road user by id."""
    present = np.flatnonzero(episode.valid[tick])
    return {episode.ids[i]: from_quanta(episode.quanta[tick, i]) for i in present}


def _read_signal_changes(episode: EpisodeRecord, tick: int) -> dict[str, str]:
    return {change.light: change.state for change in episode.signals if change.tick == tick}


def _read_arrivals(episode: EpisodeRecord, tick: int) -> list[str]:
    return [
        f"{sent.message.type} of {sent.message.sender!r} from tick {sent.message.tick} at {receiver!r}"
        for sent in episode.messages
        for receiver, fate in sent.deliveries.items()
        if fate == (DeliveryStatus.DELIVERED, tick)
    ]


def _read_contacts(episode: EpisodeRecord, tick: int) -> list[tuple[str, str]]:
    return [(contact.ego, contact.other) for at, contact in episode.contacts if at == tick]
