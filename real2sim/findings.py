"""Findings: everything one conversion of a log found out, gathered for its report page. Frame: that of the log [m]."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from mdrive_sumo.roads import RoadMap
from real2sim.clean import Cleaned
from real2sim.closeness import Closeness
from real2sim.netbuild import NetworkReport
from real2sim.quality import Quality
from real2sim.recording import Recording, Track


class Became(StrEnum):
    """What a thing of the log is in the scenario."""

    CAV = "CAV"
    BACKGROUND = "background"
    """A vehicle that SUMO drives along its schedule."""
    ACTOR = "actor"
    """A scripted road user on its path of the log."""
    STANDING = "standing"
    """A thing that never moves."""
    RSU = "roadside unit"
    LEFT_OUT = "left out"


@dataclass(frozen=True, slots=True)
class Role:
    """What became of one thing, and why; "" where the reason is plain."""

    became: Became
    reason: str = ""


@dataclass(frozen=True)
class Findings:
    """One scenario of a suite; filled by the pipeline. What was not done or measured is None."""

    id: str
    """Of the scenario: the name of its folder in the suite."""
    recording: Recording
    cleaned: Cleaned
    tracks: tuple[Track, ...]
    """Reconstructed, with the ids of `cleaned.tracks`."""
    quality: Quality
    network: NetworkReport
    roads: RoadMap
    roles: Mapping[str, Role] = field(default_factory=dict[str, Role])
    """`Fitted.roles`, by track id."""
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    """`Fitted.names`: track id -> id in the scenario."""
    closeness: Closeness | None = None
    misses: tuple[str, ...] = ()
    """What misses its target, a sentence each; () is a pass."""
    notes: tuple[str, ...] = ()
    """What the fit had to pass over, for the page; those of the reader stand in `recording`."""
    mode: str = "reactive"
    window_s: tuple[float, float] | None = None
