"""Speaker: what speaks for a CAV in a conversation, and says what was agreed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from mdrive_sumo.contract import Note
from mdrive_sumo.negotiation.conversation import Conversation
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import Intention


@dataclass(frozen=True, slots=True)
class GroupAgreement:
    """What a group has agreed on, in station ids."""

    actions: Mapping[str, Intention]
    """Of all members."""
    order: tuple[str, ...] = ()
    """All members in the order in which they pass; (): none was stated, the actions decide."""
    consensus: float | None = None
    """In [0, 1], if stated."""


class Speaker(Protocol):
    """A model, or what stands in for one. It has a budget, and gives None where it has nothing usable to say."""

    @property
    def notes(self) -> list[Note]:
        """Notes to record; the caller removes them from the list."""
        ...

    def say(self, conversation: Conversation, speaker: str, members: Mapping[str, NegotiationMember]) -> str | None:
        """Return the next message of a member of the conversation; members: all of the group, by id."""
        ...

    def conclude(
        self, conversation: Conversation, me: str, members: Mapping[str, NegotiationMember]
    ) -> GroupAgreement | None:
        """Return what follows from the messages of the last round; `me` asks."""
        ...
