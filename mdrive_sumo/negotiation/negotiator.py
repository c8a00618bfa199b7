"""What negotiation is about: members, decisions, and the negotiator that every CAV carries."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.messages import Direction, Intention


@dataclass(frozen=True, slots=True)
class NegotiationMember:
    """One CAV as the negotiation sees it now: of oneself exact, of others from their last MCM, made up for its age."""

    id: str
    """Station id, as `Message.sender` has it."""
    x: float
    y: float
    yaw: float
    speed: float
    intention: Intention
    direction: Direction
    interval_s: float
    desired: Float
    """(K, 2) where it would drive if the others let it; the first point lies one interval ahead of now."""
    planned: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(K, 2) where it means to drive."""


@dataclass(frozen=True, slots=True)
class NegotiationDecision:
    """What came of a negotiation for one CAV."""

    intention: Intention
    yield_to: frozenset[str] = frozenset()
    """Stations that go first."""
    priority_over: frozenset[str] = frozenset()
    """Stations that let me go first."""
    until_tick: int = 0
    group: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class NegotiationStep:
    """A negotiator's answer in one tick."""

    decision: NegotiationDecision | None = None
    """What holds now; None: drive as you like."""
    messages: tuple[Message, ...] = ()
    notes: tuple[Note, ...] = ()


class Negotiator(Protocol):
    """One CAV's side of all negotiations; asked on every tick, sends its own MCMs every planning step."""

    def step(self, tick: int, me: NegotiationMember, heard: Sequence[Message]) -> NegotiationStep:
        """Takes notice of what was heard and says what holds and what to send."""
        ...
