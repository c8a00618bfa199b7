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
from real2sim.clean.cleaning_report import ChangeReason
from real2sim.fidelity_targets import FidelityTarget
from real2sim.fit.traffic_fit import Disposition
from real2sim.logged_drive import LoggedDrive
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
    """Changes by reason."""
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
    """Id in the scenario."""
    became: Disposition
    reason: str


class QualityFile(_Part):
    """Content of quality.json."""

    format: Literal["mdrive-sumo/quality/1"] = "mdrive-sumo/quality/1"
    scenario: str
    source: str
    log: str
    """Id of the recording."""
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
