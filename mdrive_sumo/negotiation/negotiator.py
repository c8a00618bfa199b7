"""The negotiator of a CAV, its decision, and the members of a negotiation."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.messages import Direction, Intention


@dataclass(frozen=True, slots=True)
class NegotiationMember:
    """The present state of one CAV: the own one is its estimate, others are predicted from their last MCM."""

    id: str
    """Station id, as in `Message.sender`."""
    x: float
    y: float
    yaw: float
    speed: float
    intention: Intention
    direction: Direction
    interval_s: float
    desired: Float
    """(K, 2) positions [m] on a free road; the first point lies one interval ahead of now."""
    planned: Float = field(default_factory=lambda: np.zeros((0, 2)))
    """(K, 2) planned positions [m]."""
    position_sigma: float = 0.0
    """Standard deviations of the errors of x and of y [m], and of yaw [rad], of the own car's estimate."""
    yaw_sigma: float = 0.0
    """Standard deviation of the error of yaw [rad] of the own car's estimate."""


@dataclass(frozen=True, slots=True)
class NegotiationDecision:
    """The result of a negotiation for one CAV."""

    intention: Intention
    yield_to: frozenset[str] = frozenset()
    """Stations that go first."""
    priority_over: frozenset[str] = frozenset()
    """Stations that yield to this CAV."""
    until_tick: int = 0
    """Last tick in which it counts."""
    group: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class NegotiationStep:
    """The output of a negotiator in one tick."""

    decision: NegotiationDecision | None = None
    """The decision in force; None: no restriction."""
    messages: tuple[Message, ...] = ()
    notes: tuple[Note, ...] = ()


class Negotiator(Protocol):
    """One CAV's side of all negotiations: called while it is due, sends MCMs in every planning step."""

    def is_due(self, tick: int) -> bool:
        """Return whether `step` must be called in this tick; else it would change nothing and send nothing."""
        ...

    def get_valid_decision(self, tick: int) -> NegotiationDecision | None:
        """Return the decision if it is still in force."""
        ...

    def step(self, tick: int, me: NegotiationMember, heard: Sequence[Message]) -> NegotiationStep:
        """Process the messages received in this tick; return the decision in force and the messages to send."""
        ...
