"""Targets of a conversion: every required figure with its limit, and whether the target is met."""

from collections.abc import Mapping, Sequence

from pydantic import BaseModel, ConfigDict, computed_field

from real2sim.clean import CleanedRecording
from real2sim.fit import Disposition, TrackRole
from real2sim.logged_drive import LoggedDrive
from real2sim.network import NetworkReport
from real2sim.quality import SCRIPTED_CATEGORIES, ReconstructionQuality
from real2sim.recording import Recording
from real2sim.traffic_fidelity import MEDIAN_5S_M, ORDER_SHARE, StalledVehicle, TrafficFidelity

CENTRE_LINES_MEAN_M, CENTRE_LINES_P95_M = 0.2, 0.5
"""[m] Distances between the centre lines of the map and of the network: targets of issue C."""


class FidelityTarget(BaseModel):
    """A figure and its limit."""

    model_config = ConfigDict(frozen=True)

    name: str
    value: float | None
    """The figure; None if there was nothing to measure."""
    limit: float
    at_least: bool = False
    """Whether the limit is a minimum; otherwise it is a maximum."""
    unit: str = ""
    detail: str = ""
    """What was found, for the sentence of a missed target."""

    @computed_field
    @property
    def met(self) -> bool | None:
        """None if there is no value."""
        if self.value is None:
            return None
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def format_sentence(self) -> str:
        """Return figure and limit as a sentence."""
        value = "unknown" if self.value is None else self._format_number(self.value)
        bound = "at least" if self.at_least else "at most"
        more = f" ({self.detail})" if self.detail else ""
        return f"{self.name}: {value}, {bound} {self._format_number(self.limit)} wanted{more}"

    def _format_number(self, value: float) -> str:
        return f"{100 * value:.1f} %" if self.unit == "share" else f"{value:.3g} {self.unit}".strip()


def build_reconstruction_targets(quality: ReconstructionQuality) -> tuple[FidelityTarget, ...]:
    """Build the targets of the reconstruction against the log."""
    share = quality.moving_passed_share if quality.moving_vehicles else None
    return (
        FidelityTarget(name="moving vehicles passing all checks", value=share, limit=0.95, at_least=True, unit="share"),
        FidelityTarget(name="error median", value=quality.error_median, limit=0.3, unit="m"),
        FidelityTarget(name="error p95", value=quality.error_p95, limit=1.0, unit="m"),
        FidelityTarget(name="jerk p95", value=quality.jerk_p95, limit=5.0, unit="m/s3"),
        FidelityTarget(name="wrong-way frames", value=quality.wrong_way_frames, limit=0),
        FidelityTarget(name="spawn overlaps", value=len(quality.spawn_overlaps), limit=0),
        FidelityTarget(name="duplicate tracks", value=len(quality.duplicates), limit=0),
        FidelityTarget(name="teleports over 1 m", value=quality.teleports, limit=0),
    )


def build_network_targets(network: NetworkReport, broken_paths: int) -> tuple[FidelityTarget, ...]:
    """Build the targets of the network; `broken_paths`: moving vehicles whose path the network interrupts."""
    fit, lost_m = network.deviation, network.lost_m_by_lane
    lost = f"{sum(lost_m.values()):.1f} m of {len(lost_m)} lanes are left out of the network" if lost_m else ""
    return (
        FidelityTarget(
            name="centre lines mean",
            value=max(fit.mean, fit.back_mean),
            limit=CENTRE_LINES_MEAN_M,
            unit="m",
            detail=lost,
        ),
        FidelityTarget(
            name="centre lines p95", value=max(fit.p95, fit.back_p95), limit=CENTRE_LINES_P95_M, unit="m", detail=lost
        ),
        FidelityTarget(name="driven ways that the network breaks", value=broken_paths, limit=0),
    )


def find_silently_lost(
    recording: Recording, cleaned: CleanedRecording, roles: Mapping[str, TrackRole]
) -> tuple[str, ...]:
    """Return ids of source tracks that are missing in the scenario without a stated reason."""
    silent = TrackRole(Disposition.LEFT_OUT)
    explained = {id_ for id_, role in roles.items() if role != silent} | set(cleaned.report.drop_reason_by_track)
    source = {track.id for view in recording.views for track in view.tracks if track.valid.any()}
    return tuple(sorted(id_ for id_ in source if not explained & {id_, *cleaned.successors.get(id_, ())}))


def build_lost_target(
    recording: Recording, cleaned: CleanedRecording, roles: Mapping[str, TrackRole]
) -> FidelityTarget:
    """Build the target that every source track is in the scenario or has a stated reason."""
    lost = find_silently_lost(recording, cleaned, roles)
    return FidelityTarget(name="tracks lost without a reason", value=len(lost), limit=0)


def count_sumo_driven(quality: ReconstructionQuality, roles: Mapping[str, TrackRole], mode: str) -> int:
    """How many of the moving vehicles SUMO drives; the others are CAVs, or scripted on their path of the log."""
    moving = [actor.id for actor in quality.actors if actor.moving and actor.category not in SCRIPTED_CATEGORIES]
    driven = (id_ for id_ in moving if id_ in roles and roles[id_].disposition is Disposition.BACKGROUND)
    return 0 if mode == "replay" else sum(1 for _ in driven)


def build_traffic_targets(close: TrafficFidelity) -> tuple[FidelityTarget, ...]:
    """Build the targets of reactive traffic against the log."""
    return (
        FidelityTarget(
            name="traffic off the log at 5 s, median", value=close.median_at_5s, limit=MEDIAN_5S_M, unit="m"
        ),
        FidelityTarget(
            name="order kept at conflicts", value=close.order_share, limit=ORDER_SHARE, at_least=True, unit="share"
        ),
    )


def build_stalled_target(stalled: Sequence[StalledVehicle]) -> FidelityTarget:
    """Build the target that no background vehicle stalls when the scenario is driven."""
    return FidelityTarget(
        name="stalled",
        value=len({vehicle.id for vehicle in stalled}),
        limit=0,
        detail="; ".join(vehicle.format_sentence() for vehicle in stalled),
    )


def build_logged_drive_target(drive: LoggedDrive) -> FidelityTarget:
    """Build the target that the scorer finds no infraction in the CAVs' logged drives but those a person confirmed."""
    detail = "; ".join(
        f"CAV {cav}: {event.kind} at {event.from_s:g} s, factor {event.factor:.4g}, at ({event.x:.1f}, {event.y:.1f})"
        for cav, event in drive.unconfirmed
    )
    return FidelityTarget(
        name="unconfirmed infractions of the logged drive", value=len(drive.unconfirmed), limit=0, detail=detail
    )
