"""One conversation of a conflict group as one of its members knows it."""

import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation.negotiator import NegotiationMember

CRITIC = "critic"
_HEADER = re.compile(r"\[([0-9a-f]{8}) (\d{1,2})(?: (critic))?\] (.*)", re.DOTALL)
PATIENCE_TICKS = 20
"""Who says nothing for so long when it is his turn is passed over."""


def compute_conversation_id(group: Sequence[str]) -> str:
    """A short name that all members find for their group."""
    return hashlib.blake2b("\x00".join(sorted(group)).encode(), digest_size=4).hexdigest()


def compute_speaking_order(members: Sequence[NegotiationMember]) -> tuple[str, ...]:
    """The most central first: ascending sum of distances to the others, ties to the smaller id."""

    def remoteness(member: NegotiationMember) -> float:
        return sum(math.hypot(other.x - member.x, other.y - member.y) for other in members)

    return tuple(m.id for m in sorted(members, key=lambda m: (round(remoteness(m), 1), m.id)))


@dataclass(frozen=True, slots=True)
class Utterance:
    """A text message of a negotiation: whose group's, in which round, a car's word or the critic's."""

    conversation_id: str
    round: int
    is_critic: bool
    text: str

    def to_text(self) -> str:
        """As it is sent."""
        return f"[{self.conversation_id} {self.round}{' ' + CRITIC if self.is_critic else ''}] {self.text}"


def parse_utterance(text: str) -> Utterance | None:
    """The inverse of `Line.written`; None for any other text."""
    found = _HEADER.fullmatch(text)
    return Utterance(found[1], int(found[2]), found[3] is not None, found[4]) if found else None


@dataclass(slots=True)
class Conversation:
    """What has been said in which round, and whose turn it is."""

    group: tuple[str, ...]
    order: tuple[str, ...]
    """The first one, the most central, also says at the end of a round what was agreed."""
    last_activity_tick: int
    """When somebody last said something."""
    round: int = 1
    text_by_turn: dict[tuple[int, str], str] = field(default_factory=dict[tuple[int, str], str])
    feedback: str = ""
    is_done: bool = False
    round_opened_tick: int = -1
    """When the critic opened this round; what it announced in the same tick came of the round before."""

    @property
    def id(self) -> str:
        """See `group_name`."""
        return compute_conversation_id(self.group)

    def receive(self, tick: int, message: Message, line: Utterance) -> None:
        """Takes notice of what a member said; the critic opens the next round."""
        sender = message.sender
        if sender not in self.group or line.conversation_id != self.id:
            return
        self.last_activity_tick = tick
        if not line.is_critic:
            self.text_by_turn[line.round, sender] = " ".join(line.text.split())  # one line: nobody speaks for others
        elif sender == self.order[0] and line.round > self.round:
            self.round, self.feedback, self.is_done = line.round, " ".join(line.text.split()), False
            self.round_opened_tick = message.tick

    def find_next_speaker(self, tick: int) -> str | None:
        """Who has to speak; None when the round is over. Who keeps silent for too long is passed over."""
        waiting = [name for name in self.order if (self.round, name) not in self.text_by_turn]
        for name in waiting[: (tick - self.last_activity_tick) // PATIENCE_TICKS]:
            self.text_by_turn[self.round, name] = ""
        return next((name for name in waiting if (self.round, name) not in self.text_by_turn), None)

    def get_utterances(self, rounds: int = 99) -> list[tuple[str, str]]:
        """(id, text) of the last rounds, in the order of speaking; silence left out."""
        first = self.round - rounds + 1
        return [
            (name, text)
            for number in range(max(first, 1), self.round + 1)
            for name in self.order
            if (text := self.text_by_turn.get((number, name), ""))
        ]
