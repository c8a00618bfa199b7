"""ConversionFindings: the results of every step of converting one log, from which quality.json and its page are made.

Frame: that of the log [m].
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from mdrive_sumo.roads import RoadMap
from real2sim.clean import CleanedRecording
from real2sim.fidelity_targets import (
    FidelityTarget,
    build_logged_drive_target,
    build_lost_target,
    build_network_targets,
    build_reconstruction_targets,
    build_stalled_target,
    build_traffic_targets,
    count_sumo_driven,
)
from real2sim.fit import TrackRole
from real2sim.logged_drive import LoggedDrive
from real2sim.match import LaneMatch
from real2sim.network import NetworkReport
from real2sim.quality import ReconstructionQuality
from real2sim.recording import RecordedTrack, Recording
from real2sim.traffic_fidelity import StalledVehicle, TrafficFidelity


@dataclass(frozen=True)
class ConversionFindings:
    """Results for one scenario of a suite. None means not measured."""

    id: str
    """Scenario id: the name of its folder in the suite."""
    recording: Recording
    cleaned: CleanedRecording
    tracks: tuple[RecordedTrack, ...]
    """Reconstructed tracks with the ids of `cleaned.tracks`."""
    quality: ReconstructionQuality
    network: NetworkReport
    roads: RoadMap
    matches: Mapping[str, LaneMatch] = field(default_factory=dict[str, LaneMatch])
    """Lanes of every vehicle, by track id."""
    roles: Mapping[str, TrackRole] = field(default_factory=dict[str, TrackRole])
    """`FittedTraffic.roles`, by track id."""
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    """`FittedTraffic.names`: track id -> id in the scenario."""
    closeness: TrafficFidelity | None = None
    """Fidelity of reactive traffic, whatever the mode."""
    stalled: tuple[StalledVehicle, ...] = ()
    """Background vehicles that stall when the scenario is driven."""
    logged_drive: LoggedDrive | None = None
    notes: tuple[str, ...] = ()
    """What the conversion had to omit; notes of the reader are in `recording`, of confirmations in `logged_drive`."""
    mode: str = "reactive"
    """How the background vehicles are driven, see `Background.mode`."""
    window_s: tuple[float, float] | None = None
    """The part of the log that is converted, start and end [s]; None for the whole log."""

    @property
    def targets(self) -> tuple[FidelityTarget, ...]:
        """All figures with a target, of what was measured."""
        moving = (self.matches.get(track.id) for track in self.tracks if not track.parked)
        broken = [match for match in moving if match is not None and not match.is_off_road and match.break_frames]
        return (
            *build_reconstruction_targets(self.quality),
            *build_network_targets(self.network, len(broken)),
            build_lost_target(self.recording, self.cleaned, self.roles),
            *(build_traffic_targets(self.closeness) if self.closeness else ()),
            build_stalled_target(self.stalled),
            *((build_logged_drive_target(self.logged_drive),) if self.logged_drive else ()),
        )

    @property
    def misses(self) -> tuple[str, ...]:
        """A sentence for each target that is not met; () is a pass."""
        return tuple(target.format_sentence() for target in self.targets if target.met is False)

    @property
    def sumo_driven(self) -> int:
        """How many of the moving vehicles SUMO drives; the others are CAVs, or scripted on their path of the log."""
        return count_sumo_driven(self.quality, self.roles, self.mode)

    @property
    def all_notes(self) -> tuple[str, ...]:
        """Notes of the reader, of the conversion, and on confirmations that match nothing."""
        return (*self.recording.notes, *self.notes, *(self.logged_drive.notes if self.logged_drive else ()))
