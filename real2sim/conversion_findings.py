"""Findings: everything one conversion of a log found out, gathered for its report page. Frame: that of the log [m]."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from mdrive_sumo.roads import RoadMap
from real2sim.clean import CleanedRecording
from real2sim.fit.disposition import TrackRole
from real2sim.network import NetworkReport
from real2sim.quality import ReconstructionQuality
from real2sim.recording import RecordedTrack, Recording
from real2sim.fidelity_targets import FidelityTarget
from real2sim.traffic_fidelity import TrafficFidelity


@dataclass(frozen=True)
class ConversionFindings:
    """One scenario of a suite; filled by the pipeline. What was not done or measured is None."""

    id: str
    """Of the scenario: the name of its folder in the suite."""
    recording: Recording
    cleaned: CleanedRecording
    tracks: tuple[RecordedTrack, ...]
    """Reconstructed, with the ids of `cleaned.tracks`."""
    quality: ReconstructionQuality
    network: NetworkReport
    roads: RoadMap
    roles: Mapping[str, TrackRole] = field(default_factory=dict[str, TrackRole])
    """`Fitted.roles`, by track id."""
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    """`Fitted.names`: track id -> id in the scenario."""
    closeness: TrafficFidelity | None = None
    targets: tuple[FidelityTarget, ...] = ()
    """All of them; () where no pipeline has set any: then those of quality and closeness are shown."""
    misses: tuple[str, ...] = ()
    """What misses its target, a sentence each; () is a pass."""
    notes: tuple[str, ...] = ()
    """What the fit had to pass over, for the page; those of the reader stand in `recording`."""
    mode: str = "reactive"
    window_s: tuple[float, float] | None = None
