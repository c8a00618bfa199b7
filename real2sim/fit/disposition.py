"""Roles: what became of a thing of a log, and why."""

from dataclasses import dataclass
from enum import StrEnum


class Disposition(StrEnum):
    """What a thing of the log is in the scenario."""

    CAV = "CAV"
    BACKGROUND = "background"
    """A vehicle that SUMO drives along its schedule."""
    ACTOR = "actor"
    """A scripted road user on its path of the log."""
    STANDING = "standing"
    """A thing that never moves."""
    LEFT_OUT = "left out"


@dataclass(frozen=True, slots=True)
class TrackRole:
    """What became of one thing, and why; "" where the reason is plain."""

    disposition: Disposition
    reason: str = ""
