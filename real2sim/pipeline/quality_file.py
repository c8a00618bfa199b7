"""quality.json: fidelity of one scenario to its log, stored beside its scenario.json.

It contains no wall-clock times and no paths: the same log and options give the same bytes.
"""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.scenario.scenario import load_model
from mdrive_sumo.scenario.suite import SCENARIO_FILE, natural_sort_key
from real2sim.clean.cleaning_report import ChangeReason, CleaningReport
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_targets import FidelityTarget
from real2sim.fit import Disposition, TrackRole
from real2sim.logged_drive import LoggedDrive
from real2sim.network import NetworkReport
from real2sim.quality import ReconstructionQuality
from real2sim.traffic_fidelity import StalledVehicle, TrafficFidelity

QUALITY_FILE = "quality.json"


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True)


class CleaningChange(_Part):
    """One entry of the cleaning report."""

    reason: ChangeReason
    track: str
    frames: int
    detail: str


class CleaningFigures(_Part):
    """Changes made by cleaning."""

    counts: dict[str, int]
    """Number of changes by their reason."""
    changes: tuple[CleaningChange, ...]


class NetworkFigures(_Part):
    """The network compared with the map of the source."""

    name: str
    checksum: str
    lanes: int
    """Driving lanes of the source."""
    edges: int
    nodes: int
    connections: int
    left_hand: bool
    inverted: tuple[str, ...]
    """Lanes whose direction the vote of observed motion reversed."""
    undecided: tuple[str, ...]
    links_dropped: tuple[tuple[str, str], ...]
    links_added: tuple[tuple[str, str], ...]
    lost: dict[str, str]
    """Lane of the source -> why it, or the stated part of it, is not in the network."""
    lost_m: dict[str, float] = {}
    """Driving lane of the source -> how much of it [m] the plan of the network leaves out."""
    centre_mean_m: float
    centre_p95_m: float
    centre_max_m: float
    """The worse of source against network and network against source."""
    default_widths: int
    default_speeds: int
    signalled: tuple[str, ...]


class TrackRoleEntry(_Part):
    """Disposition of one track."""

    track: str
    name: str
    """Id of the track's object in the scenario."""
    became: Disposition
    reason: str


class QualityFile(_Part):
    """Content of quality.json."""

    format: Literal["mdrive-sumo/quality/1"] = "mdrive-sumo/quality/1"
    scenario: str
    source: str
    log: str
    """Id of the recording that was converted."""
    window_s: tuple[float, float] | None
    mode: str
    dt_s: float
    cleaning: CleaningFigures
    network: NetworkFigures
    fidelity: ReconstructionQuality
    by_sumo: int
    """Part of `fidelity.moving_vehicles`; the others are CAVs, or scripted on their path of the log."""
    fit: tuple[TrackRoleEntry, ...]
    closeness: TrafficFidelity
    stalled: tuple[StalledVehicle, ...] | None = None
    """Background vehicles that stall when the scenario is driven; None in files of versions that did not look."""
    logged_drive: LoggedDrive | None = None
    """The scorer's verdict on the CAVs' own tracks; None in files of versions before 0.2."""
    targets: tuple[FidelityTarget, ...]
    misses: tuple[str, ...]
    """Targets that are not met, a sentence each."""
    passed: bool
    notes: tuple[str, ...]


def build_quality_file(findings: ConversionFindings) -> QualityFile:
    """Return the content of quality.json. Raises ValueError for findings that lack a measurement."""
    closeness = findings.closeness
    if closeness is None:
        raise ValueError("expected findings of traffic that was measured")
    misses = findings.misses
    return QualityFile(
        scenario=findings.id,
        source=findings.recording.source,
        log=findings.recording.id,
        window_s=findings.window_s,
        mode=findings.mode,
        dt_s=findings.recording.dt_s,
        cleaning=_cleaning_figures(findings.cleaned.report),
        network=_network_figures(findings.network),
        fidelity=findings.quality,
        by_sumo=findings.sumo_driven,
        fit=_role_entries(findings),
        closeness=closeness,
        stalled=findings.stalled,
        logged_drive=findings.logged_drive,
        targets=findings.targets,
        misses=misses,
        passed=not misses,
        notes=findings.all_notes,
    )


def _cleaning_figures(report: CleaningReport) -> CleaningFigures:
    changes = (CleaningChange.model_validate(change, from_attributes=True) for change in report.changes)
    return CleaningFigures(counts=report.count_by_reason(), changes=tuple(changes))


def _network_figures(report: NetworkReport) -> NetworkFigures:
    fit = report.deviation
    same_names = NetworkFigures.model_fields.keys() & vars(report).keys()
    return NetworkFigures(
        **{name: getattr(report, name) for name in same_names},
        inverted=report.directions.inverted,
        undecided=report.directions.undecided,
        lost=dict(report.drop_reason_by_lane),
        lost_m=dict(report.lost_m_by_lane),
        centre_mean_m=max(fit.mean, fit.back_mean),
        centre_p95_m=max(fit.p95, fit.back_p95),
        centre_max_m=max(fit.max, fit.back_max),
    )


def _role_entries(findings: ConversionFindings) -> tuple[TrackRoleEntry, ...]:
    plain = TrackRole(Disposition.LEFT_OUT, "no reason was recorded")
    roles = ((track, name, findings.roles.get(track, plain)) for track, name in findings.names.items())
    return tuple(TrackRoleEntry(track=t, name=n, became=role.disposition, reason=role.reason) for t, n, role in roles)


def save_quality(quality: QualityFile, folder: Path) -> None:
    """Write `quality.json` into the scenario's folder."""
    write_text(folder / QUALITY_FILE, quality.model_dump_json(indent=1) + "\n")


def load_quality(path: Path) -> QualityFile:
    """Read one quality.json; raises InputError."""
    return load_model(path, QualityFile)


def load_qualities(suite: Path) -> tuple[QualityFile, ...]:
    """Read the quality.json of all scenarios of a suite, sorted by id; raises InputError if there is none."""
    if not suite.is_dir():
        raise InputError(f"{suite}: expected a suite folder, found none")
    paths = sorted(suite.glob(f"*/{QUALITY_FILE}"), key=lambda path: natural_sort_key(path.parent.name))
    if not paths:
        written = " (authored sources have conversion.md instead)" if (suite / "conversion.md").is_file() else ""
        raise InputError(
            f"{suite}: expected {QUALITY_FILE} beside {SCENARIO_FILE} of converted logs, found none{written}"
        )
    return tuple(map(load_quality, paths))
