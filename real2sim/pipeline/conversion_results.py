"""Collects the results of all steps of one conversion for quality.json and for the report page."""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.roads import RoadMap
from real2sim.clean import CleanedRecording
from real2sim.clean.cleaning_report import CleaningReport
from real2sim.conversion_findings import ConversionFindings
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
from real2sim.fit import FittedTraffic
from real2sim.fit.traffic_fit import Disposition, TrackRole
from real2sim.logged_drive import LoggedDrive
from real2sim.match import LaneMatch
from real2sim.network import NetworkReport
from real2sim.pipeline.quality_file import CleaningChange, CleaningFigures, NetworkFigures, QualityFile, TrackRoleEntry
from real2sim.quality import ReconstructionQuality
from real2sim.recording import RecordedTrack, Recording
from real2sim.traffic_fidelity import StalledVehicle, TrafficFidelity


@dataclass(frozen=True)
class ConversionResults:
    """Results of every step of one conversion."""

    id: str
    recording: Recording
    window_s: tuple[float, float] | None
    cleaned: CleanedRecording
    tracks: tuple[RecordedTrack, ...]
    """Reconstructed tracks."""
    network: NetworkReport
    roads: RoadMap
    matches: Mapping[str, LaneMatch]
    quality: ReconstructionQuality
    fitted: FittedTraffic
    closeness: TrafficFidelity
    """Fidelity of reactive traffic, whatever the mode."""
    stalled: tuple[StalledVehicle, ...]
    """Background vehicles that stall when the scenario is driven."""
    logged_drive: LoggedDrive
    notes: tuple[str, ...]
    """What the conversion had to omit; the reader's notes are in `recording`."""

    @property
    def targets(self) -> tuple[FidelityTarget, ...]:
        """All figures with a target."""
        broken = [
            track.id for track in self.tracks if not track.parked and _is_route_broken(self.matches.get(track.id))
        ]
        return (
            *build_reconstruction_targets(self.quality),
            *build_network_targets(self.network, broken),
            build_lost_target(self.recording, self.cleaned, self.fitted.roles),
            *build_traffic_targets(self.closeness),
            build_stalled_target(self.stalled),
            build_logged_drive_target(self.logged_drive),
        )

    @property
    def misses(self) -> tuple[str, ...]:
        """Targets that are not met."""
        return tuple(target.format_sentence() for target in self.targets if target.met is False)


def _is_route_broken(match: LaneMatch | None) -> bool:
    return match is not None and not match.is_off_road and bool(match.break_frames)


def build_quality_file(steps: ConversionResults) -> QualityFile:
    """Return the content of quality.json."""
    return QualityFile(
        scenario=steps.id,
        source=steps.recording.source,
        log=steps.recording.id,
        window_s=steps.window_s,
        mode=steps.fitted.background.mode,
        dt_s=steps.recording.dt_s,
        cleaning=_cleaning_figures(steps.cleaned.report),
        network=_network_figures(steps.network),
        fidelity=steps.quality,
        by_sumo=count_sumo_driven(steps.quality, steps.fitted.roles, steps.fitted.background.mode),
        fit=_role_entries(steps.fitted),
        closeness=steps.closeness,
        stalled=steps.stalled,
        logged_drive=steps.logged_drive,
        targets=steps.targets,
        misses=steps.misses,
        passed=not steps.misses,
        notes=(*steps.recording.notes, *steps.notes, *steps.logged_drive.notes),
    )


def build_findings(steps: ConversionResults) -> ConversionFindings:
    """Return the same results for the report page."""
    return ConversionFindings(
        id=steps.id,
        recording=steps.recording,
        cleaned=steps.cleaned,
        tracks=steps.tracks,
        quality=steps.quality,
        network=steps.network,
        roads=steps.roads,
        roles=steps.fitted.roles,
        names=steps.fitted.names,
        closeness=steps.closeness,
        stalled=steps.stalled,
        logged_drive=steps.logged_drive,
        targets=steps.targets,
        misses=steps.misses,
        notes=(*steps.notes, *steps.logged_drive.notes),
        mode=steps.fitted.background.mode,
        window_s=steps.window_s,
    )


def _cleaning_figures(report: CleaningReport) -> CleaningFigures:
    changes = (
        CleaningChange(reason=change.reason, track=change.track, frames=change.frames, detail=change.detail)
        for change in report.changes
    )
    return CleaningFigures(counts=report.count_by_reason(), changes=tuple(changes))


def _network_figures(report: NetworkReport) -> NetworkFigures:
    fit = report.deviation
    return NetworkFigures(
        name=report.name,
        checksum=report.checksum,
        lanes=report.lanes,
        edges=report.edges,
        nodes=report.nodes,
        connections=report.connections,
        left_hand=report.left_hand,
        inverted=report.directions.inverted,
        undecided=report.directions.undecided,
        links_dropped=report.links_dropped,
        links_added=report.links_added,
        lost=dict(report.drop_reason_by_lane),
        lost_m=dict(report.lost_m_by_lane),
        centre_mean_m=max(fit.mean, fit.back_mean),
        centre_p95_m=max(fit.p95, fit.back_p95),
        centre_max_m=max(fit.max, fit.back_max),
        default_widths=report.default_widths,
        default_speeds=report.default_speeds,
        signalled=report.signalled,
    )


def _role_entries(fitted: FittedTraffic) -> tuple[TrackRoleEntry, ...]:
    plain = TrackRole(Disposition.LEFT_OUT, "no reason was recorded")
    roles = ((track, name, fitted.roles.get(track, plain)) for track, name in fitted.names.items())
    return tuple(TrackRoleEntry(track=t, name=n, became=role.disposition, reason=role.reason) for t, n, role in roles)
