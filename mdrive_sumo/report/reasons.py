"""Reasons that agents noted (`contract.Reason`), in words, with road users named as the recording names them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract import MAX_OTHER_NAME, REASON, Cause, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.clean_text import clean_line, truncate
from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import EpisodeRecord, NoteRecord

MATCH_M = 3.0
"""[m] A road user whose centre is this close to where an agent believes one is the one that it means: more than the
errors of detectors and of the own pose (below 1 m in all sensing profiles), less than two cars in a queue are apart."""
MAX_SENTENCE = 300
"""Characters of a sentence that an agent of a participant writes."""
KIND_WORDS: Mapping[int, str] = MappingProxyType(
    {Kind.VEHICLE: "vehicle", Kind.PEDESTRIAN: "pedestrian", Kind.CYCLIST: "cyclist", Kind.STATIC: "obstacle"}
)

SENTENCES: Mapping[Cause, str] = MappingProxyType(
    {
        Cause.FREE: "drives freely, at up to {speed}",
        Cause.SPEED_LIMIT: "keeps to a speed limit of {speed}{here}",
        Cause.BEND: "drives towards a bend{here} that allows {speed}",
        Cause.FOLLOW: "follows {names}{gap}",
        Cause.BLOCKED: "is held up by {names}, {which} stands in its way{gap}",
        Cause.YIELD: "yields to {names}, {crosses}",
        Cause.AVOID: "keeps clear of {names}{meets}",
        Cause.ONCOMING: "waits for {names}, {which} is in the way of its detour{gap}",
        Cause.OBSTACLE: "stops where it can still turn out for {names}, {which} stands in its way{gap}",
        Cause.STOP_SIGN: "stops at a stop sign{here}",
        Cause.LIGHT: "stops at traffic light {names}{gap}",
        Cause.AGREEMENT: "lets {names} go first, as negotiated",
        Cause.ANNOUNCED: "keeps clear of the way that {names} has announced{meets}",
        Cause.HAZARD: "stops for {names}, {which} its detector sees{here} in its way",
        Cause.NO_WAY: "finds no way past {names}",
        Cause.PEDESTRIAN: "is careful of {names} beside the road, {which} may step out",
        Cause.TURN: "waits for its turn{begins}",
        Cause.MEMORY: "repeats a drive that it knows by heart",
        Cause.STATIONARY: "stands, as this agent always does",
        Cause.NETWORK_DRIVES: "follows its network, which plans {speed} on average",
        Cause.NETWORK_BRAKES: "follows its network, which plans to slow down to {speed} on average",
        Cause.NETWORK_STANDS: "follows its network, which plans to stand",
        Cause.CREEP: "creeps ahead by rule, because its network kept it standing",
    }
)
"""What a CAV does for each cause, without its subject."""
AVOID_UNNAMED = "drives slower than it would alone"
"""The sentence of `Cause.AVOID` if the agent does not name the other: all that it knows."""
MIN_DISTANCE_M = 0.05
"""[m] A shorter distance would be told as 0.0 m: a sentence leaves it out."""


@dataclass(frozen=True, slots=True)
class NotedReason:
    """A reason that holds from a tick on."""

    tick: int
    ego: str
    cause: Cause | None
    """None for a sentence of an agent's own."""
    others: tuple[str, ...]
    """Names of the other road users, such as "CAV 3"."""
    text: str
    """What the CAV does and why, without its subject: "yields to CAV 3, which crosses in 2.1 s"."""

    @property
    def limits(self) -> bool:
        """Whether it is more than the route: something that a newcomer would ask for."""
        return self.cause not in (Cause.FREE, Cause.BEND, Cause.SPEED_LIMIT, Cause.NETWORK_DRIVES)

    @property
    def drives_on(self) -> bool:
        """Whether the agent has no reason to be slow: what slows its CAV is something else, such as a contact."""
        return self.cause in (Cause.FREE, Cause.NETWORK_DRIVES)

    @property
    def key(self) -> tuple[Cause | None, tuple[str, ...], str]:
        """What two reasons of one story have in common: their texts differ in numbers at least."""
        return self.cause, self.others, "" if self.cause else self.text


def list_reasons(episode: EpisodeRecord) -> list[NotedReason]:
    """Return the reasons that the agents of an episode noted, in order; not those without any text."""
    read = [read_reason(episode, record) for record in episode.notes if record.note.kind == REASON]
    return [reason for reason in read if reason.text]


def read_reason(episode: EpisodeRecord, record: NoteRecord) -> NotedReason:
    """Return one note of kind `REASON` in words."""
    reason = Reason.from_note(record.note)
    if reason is None:
        sentence = _clean_text(episode.restore_names(record.note.text), MAX_SENTENCE)
        return NotedReason(record.tick, record.ego, None, (), sentence)
    named = (
        _name_other(episode, record, other, reason.position if i == 0 else None)
        for i, other in enumerate(reason.others)
    )
    others = tuple(name for name in named if name)
    return NotedReason(record.tick, record.ego, reason.cause, others, describe_reason(reason, others))


def name_road_user(episode: EpisodeRecord, name: str) -> str:
    """Return kind and id of a road user of the recording: "CAV 3", "pedestrian p1"."""
    if name in episode.ego_ids:
        return f"CAV {name}"
    return f"{KIND_WORDS[int(episode.kind[episode.ids.index(name)])]} {name}"


def _name_other(episode: EpisodeRecord, record: NoteRecord, other: str, position: tuple[float, float] | None) -> str:
    """Return the name of a road user that an agent knows by its pseudonym, or by a track name and a position.

    "" if the agent gives neither a name nor a position.
    """
    known_as = episode.restore_name(other)
    if known_as in episode.ids:
        return name_road_user(episode, known_as)
    if position is None:
        return _clean_text(known_as, MAX_OTHER_NAME)  # a traffic light, or a road user that the agent only names
    tick = min(record.tick, episode.ticks - 1)
    gap_m = portable.hypot(episode.x[tick] - position[0], episode.y[tick] - position[1])
    present = episode.valid[tick] & (np.array(episode.ids) != record.ego)
    near = np.where(present, gap_m - np.maximum(episode.length / 2 - MATCH_M, 0.0), np.inf)
    nearest = int(near.argmin())
    if near[nearest] <= MATCH_M:
        return name_road_user(episode, episode.ids[nearest])
    return f"{_clean_text(other, MAX_OTHER_NAME) or 'something'} (a false detection: nothing is there)"


def _clean_text(text: str, max_length: int) -> str:
    """Return what an agent wrote as part of a line: it can neither end the line nor show other text than there is."""
    return truncate(clean_line(" ".join(text.split())), max_length)


def describe_reason(reason: Reason, others: tuple[str, ...]) -> str:
    """Return what the CAV does and why, without its subject; others: names of `Reason.others`."""
    if reason.cause is Cause.AVOID and not others:
        return AVOID_UNNAMED
    names = join_names(others) or "another road user"
    which = "who" if names.startswith((KIND_WORDS[Kind.PEDESTRIAN], KIND_WORDS[Kind.CYCLIST])) else "which"
    seconds = None if reason.seconds is None else f"in {reason.seconds:.1f} s"
    metres = reason.distance_m or 0.0
    distance = "" if metres < MIN_DISTANCE_M else f"{metres:.{1 if metres < 10 else 0}f} m ahead"
    return SENTENCES[reason.cause].format(
        names=names,
        which=which,
        here=f" {distance}" if distance else "",
        gap=f", {distance}" if distance else "",
        meets=f", {which} it would meet {seconds}" if seconds else "",
        crosses=f"{which} crosses {seconds}" if seconds else f"{which} stands where their ways cross",
        begins=f", which begins {seconds}" if seconds else "",
        speed="an unknown speed" if reason.speed is None else f"{reason.speed:.1f} m/s",
    )


def join_names(names: tuple[str, ...]) -> str:
    """Return "A, B and C"; "" without names."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""
