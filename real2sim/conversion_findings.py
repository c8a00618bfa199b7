"""ConversionFindings: all results of converting one log, input of its report page. Frame: that of the log [m]."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from mdrive_sumo.roads import RoadMap
from real2sim.clean import CleanedRecording
from real2sim.fidelity_targets import FidelityTarget
from real2sim.fit.traffic_fit import TrackRole
from real2sim.logged_drive import LoggedDrive
from real2sim.network import NetworkReport
from real2sim.quality import ReconstructionQuality
from real2sim.recording import RecordedTrack, Recording
from real2sim.traffic_fidelity import StalledVehicle, TrafficFidelity


@dataclass(frozen=True)
class ConversionFindings:
    """Results for one scenario of a suite. None means not done or not measured."""

    id: str
    """Scenario id: the name of its folder in the suite."""
    recording: Recording
    cleaned: CleanedRecording
    tracks: tuple[RecordedTrack, ...]
    """Reconstructed tracks with the ids of `cleaned.tracks`."""
    quality: ReconstructionQuality
    network: NetworkReport
    roads: RoadMap
    roles: Mapping[str, TrackRole] = field(default_factory=dict[str, TrackRole])
    """`Fitted.roles`, by track id."""
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    """`Fitted.names`: track id -> id in the scenario."""
    closeness: TrafficFidelity | None = None
    stalled: tuple[StalledVehicle, ...] = ()
    logged_drive: LoggedDrive | None = None
    targets: tuple[FidelityTarget, ...] = ()
    """All targets; () if the pipeline has set none: then those of quality and traffic fidelity are shown."""
    misses: tuple[str, ...] = ()
    """One sentence for each missed target; () is a pass."""
    notes: tuple[str, ...] = ()
    """What the fit skipped; notes of the reader are in `recording`."""
    mode: str = "reactive"
    window_s: tuple[float, float] | None = None
