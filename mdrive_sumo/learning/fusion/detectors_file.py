"""`detectors.json` of `learn evaluate-detectors`, read back."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.learning.fusion.detector_figures import FigureKey
from mdrive_sumo.learning.fusion.detector_tables import FORMAT, DetectorSummary
from mdrive_sumo.scenario.scenario import load_model

DETECTORS_FILE = "detectors.json"
COMPARED = (
    FigureKey("clean", 0.5, "all"),
    FigureKey("clean", 0.7, "all"),
    FigureKey("0.2 m, 100 ms", 0.5, "all"),
    FigureKey("estimated", 0.5, "all"),
)
"""Precisions whose order stands beside that of scores: the usual two, V2XSet's noise, and poses as drives have them."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class _Interval(_Part):
    detector: str
    condition: str
    iou: float
    mean: float
    low: float | None
    high: float | None
    units: int
    p_value: float

    def make_interval(self) -> ConfidenceInterval:
        """Return mean and bounds."""
        return ConfidenceInterval(self.mean, self.low, self.high, self.units, self.p_value)


class _Precision(_Interval):
    group: str


class _Difference(_Interval):
    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)  # `from` is always BASE


class _DetectorsFile(_Part):
    format: Literal["mdrive-sumo/detectors/1"] = FORMAT
    about: dict[str, dict[str, Any]]
    precisions: tuple[_Precision, ...]
    differences: tuple[_Difference, ...]
    use: dict[str, dict[str, dict[str, float]]]


def read_detectors(path: Path) -> DetectorSummary:
    """Return what a `detectors.json` holds. Raises InputError for another file."""
    file = load_model(path, _DetectorsFile)
    if not file.about:
        raise InputError(f"{path}: about: expected one detector or more, found none")
    precisions: dict[str, dict[FigureKey, ConfidenceInterval]] = {name: {} for name in file.about}
    differences: dict[str, dict[str, ConfidenceInterval]] = {}
    for row in file.precisions:
        if row.detector not in precisions:
            raise InputError(f"{path}: precisions: expected one of {', '.join(precisions)}, found {row.detector!r:.40}")
        precisions[row.detector][FigureKey(row.condition, row.iou, row.group)] = row.make_interval()
    for row in file.differences:
        differences.setdefault(row.detector, {})[row.condition] = row.make_interval()
    return DetectorSummary(file.about, precisions, differences, file.use)


def list_compared(summary: DetectorSummary) -> Mapping[str, Mapping[str, float]]:
    """Return the precisions of `COMPARED` [%] by name, then by detector."""
    return {
        f"AP@{key.min_iou} {key.condition}": {
            name: 100 * intervals[key].mean for name, intervals in summary.precisions.items() if key in intervals
        }
        for key in COMPARED
    }
