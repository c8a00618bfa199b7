"""One conversation of a conflict group as one of its members knows it."""

import hashlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation.types import Member

CRITIC = "critic"
_HEADER = re.compile(r"\[([0-9a-f]{8}) (\d{1,2})(?: (critic))?\] (.*)", re.DOTALL)
PATIENCE_TICKS = 20
"""Who says nothing for so long when it is his turn is passed over."""


def group_name(group: Sequence[str]) -> str:
    """A short name that all members find for their group."""
    return hashlib.blake2b("\x00".join(sorted(group)).encode(), digest_size=4).hexdigest()


def speaking_order(members: Sequence[Member]) -> tuple[str, ...]:
    """The most central first: ascending sum of distances to the others, ties to the smaller id."""

    def remoteness(member: Member) -> float:
        return sum(math.hypot(other.x - member.x, other.y - member.y) for other in members)

    return tuple(m.id for m in sorted(members, key=lambda m: (round(remoteness(m), 1), m.id)))


@dataclass(frozen=True, slots=True)
class Line:
    """A text message of a negotiation: whose group's, in which round, a car's word or the critic's."""

    talk: str
    round: int
    critic: bool
    text: str

    def written(self) -> str:
        """As it is sent."""
        return f"[{self.talk} {self.round}{' ' + CRITIC if self.critic else ''}] {self.text}"


def read_line(text: str) -> Line | None:
    """The inverse of `Line.written`; None for any other text."""
    found = _HEADER.fullmatch(text)
    return Line(found[1], int(found[2]), found[3] is not None, found[4]) if found else None


@dataclass(slots=True)
class Talk:
    """What has been said in which round, and whose turn it is."""

    group: tuple[str, ...]
    order: tuple[str, ...]
    """The first one, the most central, also says at the end of a round what was agreed."""
    heard_tick: int
    """When somebody last said something."""
    round: int = 1
    said: dict[tuple[int, str], str] = field(default_factory=dict[tuple[int, str], str])
    feedback: str = ""
    done: bool = False
    opened_tick: int = -1
    """When the critic opened this round; what it announced in the same tick came of the round before."""

    @property
    def name(self) -> str:
        """See `group_name`."""
        return group_name(self.group)

    def note(self, tick: int, message: Message, line: Line) -> None:
        """Takes notice of what a member said; the critic opens the next round."""
        sender = message.sender
        if sender not in self.group or line.talk != self.name:
            return
        self.heard_tick = tick
        if not line.critic:
            self.said[line.round, sender] = " ".join(line.text.split())  # one line: nobody speaks for others
        elif sender == self.order[0] and line.round > self.round:
            self.round, self.feedback, self.done = line.round, " ".join(line.text.split()), False
            self.opened_tick = message.tick

    def turn_of(self, tick: int) -> str | None:
        """Who has to speak; None when the round is over. Who keeps silent for too long is passed over."""
        waiting = [name for name in self.order if (self.round, name) not in self.said]
        for name in waiting[: (tick - self.heard_tick) // PATIENCE_TICKS]:
            self.said[self.round, name] = ""
        return next((name for name in waiting if (self.round, name) not in self.said), None)

    def conversation(self, rounds: int = 99) -> list[tuple[str, str]]:
        """(id, text) of the last rounds, in the order of speaking; silence left out."""
        first = self.round - rounds + 1
        return [
            (name, text)
            for number in range(max(first, 1), self.round + 1)
            for name in self.order
            if (text := self.said.get((number, name), ""))
        ]
