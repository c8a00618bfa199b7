"""Average precision of trained detectors, as `learn evaluate-detectors` measured it on frames that nobody drives (RQ3).

`learning` writes the file and is a room beside this one, so what is read of it stands here.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.open_loop import OpenLoopResults
from mdrive_sumo.scenario.scenario import load_model
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.paper.open_closed import OpenClosedComparison, compare_open_with_closed
from mdrive_sumo.study.paper.paper_study import DETECTOR_PREFIX

MEASURED: Mapping[str, tuple[str, float]] = {
    "ap50_clean": ("clean", 0.5),
    "ap70_clean": ("clean", 0.7),
    "ap50_estimated": ("estimated", 0.5),
}
"""Condition and least intersection over union of each metric. `estimated`: poses have errors, as in drives."""
DetectorPrecisions = Mapping[str, Mapping[str, ConfidenceInterval]]
"""[%] By metric of `MEASURED` and agent."""


class _Precision(BaseModel):
    model_config = ConfigDict(frozen=True)

    detector: str
    condition: str
    iou: float
    group: str
    mean: float = Field(ge=0, le=1)
    low: float | None
    high: float | None
    units: int


class _DetectorFile(BaseModel):
    model_config = ConfigDict(frozen=True)

    format: Literal["mdrive-sumo/detectors/1"]
    precisions: tuple[_Precision, ...]


def load_precisions(path: Path) -> DetectorPrecisions:
    """Return the precisions of detectors.json. Raises InputError for another file, and if it has none of `MEASURED`."""
    entries = {
        (one.condition, one.iou, one.detector): one
        for one in load_model(path, _DetectorFile).precisions
        if one.group == "all"
    }
    found = {
        metric: {
            f"{DETECTOR_PREFIX}{one.detector}": _make_percent(one)
            for (*about, _), one in entries.items()
            if tuple(about) == wanted
        }
        for metric, wanted in MEASURED.items()
    }
    if not any(found.values()):
        raise InputError(f"{path}: precisions: expected those of detectors in clean frames, found none")
    return found


def compare_detectors(
    opened: Mapping[str, OpenLoopResults], closed: Mapping[str, Results], precisions: DetectorPrecisions
) -> OpenClosedComparison:
    """Return the metrics and correlations of the agents that differ in their detector only, surrogates included."""
    return compare_open_with_closed(
        {name: results for name, results in opened.items() if name.startswith(DETECTOR_PREFIX)},
        closed,
        {metric: {agent: one.mean for agent, one in each.items()} for metric, each in precisions.items()},
    )


def _make_percent(one: _Precision) -> ConfidenceInterval:
    low, high = (None if end is None else 100 * end for end in (one.low, one.high))
    return ConfidenceInterval(100 * one.mean, low, high, one.units)
