"""What the supervisor of a drive and its processes say to each other, besides what it passes on for the server."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum, auto
from pathlib import Path

from server.drive.simulation_values import WhatIfBranch
from server.drive.take_tree import DriverChange, TakeTree
from server.drive.worker.take_journal import JournalHeader, summarize_journal


class TakeMode(StrEnum):
    """What a process does once it has come to the tick of its order."""

    DRIVE = auto()
    """People drive on in real time."""
    FINISH = auto()
    """A take of an earlier session is finished as left."""
    WHAT_IF = auto()
    """Agents drive for some seconds; nothing is stored."""
    HOLD = auto()
    """It leaves a checkpoint in that tick."""


@dataclass(frozen=True, slots=True)
class TakeOrder:
    """One take to simulate."""

    header: JournalHeader
    """Take, parent, the tick to which actions are repeated, and the entered run's share of them."""
    mode: TakeMode
    source: Path | None
    """The journal with the actions before that tick; None: there are none, or those of the entered run."""
    journal: Path
    """The journal of the take."""
    folder: Path
    """The run folder of the take."""
    people_take_over: bool = False
    """Whether CAVs of people are driven by them from the tick on, whatever drove before."""
    agent: str = ""
    """The agent of a what-if branch."""
    place: int = 0
    """Of the branch among those of its call."""
    seconds: float = 0.0
    """Length of a what-if branch [s]."""
    cavs: tuple[str, ...] = ()
    """The CAVs that the agent of a what-if branch takes over; none: those of people."""
    device: str = "unknown"
    """Input device, provenance."""
    latency_ms: float = 0.0
    """Median latency of inputs [ms], provenance."""


@dataclass(frozen=True, slots=True)
class LeaveOrder:
    """The people leave the take in its current tick."""


@dataclass(frozen=True, slots=True)
class FinishOrder:
    """A take that was left has its turn to be finished."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """With what people drive."""

    device: str
    latency_ms: float


def make_order(
    tree: TakeTree, branch: tuple[int, int | None, int], mode: TakeMode, provenance: Provenance
) -> TakeOrder:
    """Return an order. branch: the take, the take whose actions are repeated (None: none), and up to which tick.

    Raises InputError for a journal that cannot be read.
    """
    take, parent, tick = branch
    source = tree.find_journal(parent) if parent is not None else None
    entered = summarize_journal(source)[0].entered_tick if source is not None else 0
    return TakeOrder(
        JournalHeader(take, parent, tick, min(entered, tick)),
        mode,
        source,
        tree.find_journal(take),
        tree.find_folder(take),
        device=provenance.device,
        latency_ms=provenance.latency_ms,
    )


@dataclass(frozen=True, slots=True)
class TakeAlive:
    """A process that simulates a take works: said at its start, and every second while it owes no frames."""

    process: int
    """Its number."""


@dataclass(frozen=True, slots=True)
class CheckpointMade:
    """A checkpoint waits; its socket comes with the message."""

    take: int
    tick: int


@dataclass(frozen=True, slots=True)
class TakeReady:
    """The take is in the tick of its order, and its journal is on disk."""

    header: JournalHeader
    drivers: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class TakeRefused:
    """The order cannot be followed; one sentence."""

    text: str
    has_diverged: bool = False
    """Whether the repeated drive differs from the recorded one."""


@dataclass(frozen=True, slots=True)
class TakeDropped:
    """The take was left before its first tick: there is nothing to store."""

    take: int


@dataclass(frozen=True, slots=True)
class TakeFinished:
    """The take is scored and stored."""

    take: int
    end_tick: int
    score: float
    ds: Mapping[str, float]
    losses: Mapping[str, str]
    """What cost score, in words, by CAV."""
    changes: Sequence[DriverChange]
    """Who drove from which tick on, from tick 0."""
    left_tick: int | None
    motion: bytes
    """See `motion.pack_motion`."""


@dataclass(frozen=True, slots=True)
class MotionLoaded:
    """The motion of a recording."""

    take: int
    motion: bytes


@dataclass(frozen=True, slots=True)
class WhatIfDone:
    """A what-if branch."""

    branch: WhatIfBranch
