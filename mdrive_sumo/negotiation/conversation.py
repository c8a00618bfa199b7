"""One conversation of a conflict group as one of its members knows it."""

import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from mdrive_sumo.contract import Message
from mdrive_sumo.core import portable
from mdrive_sumo.negotiation.negotiator import NegotiationMember

CRITIC = "critic"
"""Word in the header of what the critic says."""
_HEADER = re.compile(r"\[([0-9a-f]{8}) (\d{1,2})(?: (critic))?\] (.*)", re.DOTALL)
PATIENCE_TICKS = 20
"""A member that says nothing for this long when it has the turn is skipped."""


def compute_conversation_id(group: Sequence[str]) -> str:
    """Return a short id that all members compute for their group."""
    return hashlib.blake2b("\x00".join(sorted(group)).encode(), digest_size=4).hexdigest()


def compute_speaking_order(members: Sequence[NegotiationMember]) -> tuple[str, ...]:
    """Return the ids, most central member first: ascending sum of distances to the others, ties to the smaller id."""

    def compute_remoteness(member: NegotiationMember) -> float:
        return math.fsum(portable.hypot(other.x - member.x, other.y - member.y) for other in members)

    return tuple(m.id for m in sorted(members, key=lambda m: (round(compute_remoteness(m), 1), m.id)))


@dataclass(frozen=True, slots=True)
class Utterance:
    """A text message of a negotiation: its conversation, its round, and whether a member or the critic sends it."""

    conversation_id: str
    round: int
    is_critic: bool
    text: str

    def to_text(self) -> str:
        """Return the text that is sent."""
        critic = " " + CRITIC if self.is_critic else ""
        return f"[{self.conversation_id} {self.round}{critic}] {self.text}"


def parse_utterance(text: str) -> Utterance | None:
    """Invert `Utterance.to_text`; None for any other text."""
    found = _HEADER.fullmatch(text)
    return Utterance(found[1], int(found[2]), found[3] is not None, found[4]) if found else None


@dataclass(slots=True)
class Conversation:
    """The utterances by round, and the member that has the turn."""

    group: tuple[str, ...]
    order: tuple[str, ...]
    """The first member, the most central one, also states at the end of a round what was agreed."""
    last_activity_tick: int
    """Tick of the last utterance, or of the beginning."""
    round: int = 1
    text_by_turn: dict[tuple[int, str], str] = field(default_factory=dict[tuple[int, str], str])
    """By (round, member)."""
    feedback: str = ""
    """The critic's objection to the last round; "" if there is none."""
    is_done: bool = False
    """Whether the group has agreed, or has changed."""
    round_opened_tick: int = -1
    """When the critic opened this round; its announcement in the same tick belongs to the previous round."""

    @property
    def id(self) -> str:
        """See `compute_conversation_id`."""
        return compute_conversation_id(self.group)

    def receive(self, tick: int, message: Message, utterance: Utterance) -> None:
        """Store the utterance of a member; the critic opens the next round."""
        sender = message.sender
        if sender not in self.group or utterance.conversation_id != self.id:
            return
        self.last_activity_tick = tick
        text = " ".join(utterance.text.split())  # one line, so that no member can imitate others
        if not utterance.is_critic:
            self.text_by_turn[utterance.round, sender] = text
        elif sender == self.order[0] and utterance.round > self.round:
            self.round, self.feedback, self.is_done = utterance.round, text, False
            self.round_opened_tick = message.tick

    def find_next_speaker(self, tick: int) -> str | None:
        """Return the member that has the turn, None when the round is over; members silent for too long are skipped."""
        waiting = [name for name in self.order if (self.round, name) not in self.text_by_turn]
        for name in waiting[: (tick - self.last_activity_tick) // PATIENCE_TICKS]:
            self.text_by_turn[self.round, name] = ""
        return next((name for name in waiting if (self.round, name) not in self.text_by_turn), None)

    def get_utterances(self, rounds: int = 99) -> list[tuple[str, str]]:
        """Return (id, text) of the last rounds in speaking order, without silent members."""
        first = self.round - rounds + 1
        return [
            (name, text)
            for number in range(max(first, 1), self.round + 1)
            for name in self.order
            if (text := self.text_by_turn.get((number, name), ""))
        ]
