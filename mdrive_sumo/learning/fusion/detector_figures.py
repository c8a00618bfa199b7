"""DetectorFigures: what was measured of a detector, with resamples, so that detectors can be compared in pairs."""

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_bytes
from mdrive_sumo.core.statistics import ResampledMean
from mdrive_sumo.learning.fusion.average_precision import GROUPS, count_detections
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.frames import FusionFrames

FORMAT = "mdrive-sumo detector figures 1"
MIN_IOUS = (0.5, 0.7)
CLEAN = CONDITIONS[0].name
SUFFIX = ".figures.npz"
_NPZ_ERRORS = (zipfile.BadZipFile, ValueError, OSError, EOFError, KeyError, TypeError)


@dataclass(frozen=True, slots=True)
class FigureKey:
    """Of one average precision."""

    condition: str
    """A condition, a channel or a budget."""
    min_iou: float
    group: str
    """Of `average_precision.GROUPS`."""


@dataclass(slots=True)
class DetectorFigures:
    """Average precisions of vehicles in [0, 1] that one detector has on a data set."""

    detector: str
    about: dict[str, Any]
    """Frames, drives, places, checkpoint: JSON."""
    precisions: dict[FigureKey, ResampledMean] = field(default_factory=dict[FigureKey, ResampledMean])
    """Groups without true boxes are missing."""
    use: dict[str, dict[str, float]] = field(default_factory=dict[str, dict[str, float]])
    """By channel or budget: bytes of a map, and what arrived."""

    def add(self, frames: FusionFrames, condition: str, found: Sequence[DetectedBoxes]) -> None:
        """Measure the boxes found in all frames under a condition; groups of boxes in the clean one only."""
        groups = tuple(GROUPS) if condition == CLEAN else ("all",)
        for min_iou in MIN_IOUS:
            counts = count_detections(frames, found, min_iou)
            for group in groups:
                if (value := counts[group].resample()) is not None:
                    self.precisions[FigureKey(condition, min_iou, group)] = value

    def repeat(self, condition: str, like: str) -> None:
        """Take the figures of another condition, which changes nothing for this detector."""
        for key, value in list(self.precisions.items()):
            if key.condition == like:
                self.precisions[FigureKey(condition, key.min_iou, key.group)] = value


def describe_frames(frames: FusionFrames) -> dict[str, Any]:
    """Return what must be the same of figures that are compared."""
    drives = {*zip(frames.place.tolist(), frames.episode.tolist(), strict=True)}
    return {
        "frames": len(frames),
        "drives": len(drives),
        "places": sorted({frames.places[place] for place in frames.place.tolist()}),
        "vehicles": int((frames.is_target & (frames.box_class == 0)).sum()),
        "cells": int(frames.cells.astype(np.int64).sum()),
    }


def write_figures(folder: Path, figures: DetectorFigures) -> Path:
    """Write DIR/NAME.figures.npz and return its path. Raises OSError."""
    keys = list(figures.precisions)
    values = [figures.precisions[key] for key in keys]
    meta = {
        "format": FORMAT,
        "detector": figures.detector,
        "about": figures.about,
        "use": figures.use,
        "keys": [[key.condition, key.min_iou, key.group] for key in keys],
        "units": [value.units for value in values],
        "effective": [value.effective for value in values],
    }
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        meta=np.array(json.dumps(meta)),
        means=np.array([value.mean for value in values]),
        resampled=np.array([value.resampled for value in values]),
    )
    make_folder(folder)
    write_bytes(folder / f"{figures.detector}{SUFFIX}", buffer.getvalue())
    return folder / f"{figures.detector}{SUFFIX}"


def read_figures(path: Path) -> DetectorFigures:
    """Return the figures of a file. Raises InputError for another file."""
    try:
        with np.load(io.BytesIO(read_bytes(path)), allow_pickle=False) as archive:
            meta: dict[str, Any] = json.loads(str(archive["meta"]))
            means, resampled = archive["means"], archive["resampled"]
        if meta["format"] != FORMAT:
            raise ValueError(f"format {meta['format']!r:.40}")
        figures = DetectorFigures(meta["detector"], meta["about"], {}, meta["use"])
        columns = zip(meta["keys"], means.tolist(), resampled, meta["units"], meta["effective"], strict=True)
        for key, mean, values, units, effective in columns:
            figures.precisions[FigureKey(*key)] = ResampledMean(mean, values, units, effective)
    except _NPZ_ERRORS as error:
        raise InputError(
            f"{path}: expected figures of `learn evaluate-detectors`, found {' '.join(str(error).split())[:120]}"
        ) from None
    return figures


def check_comparable(figures: Mapping[str, DetectorFigures]) -> None:
    """Raise InputError unless all detectors were measured on the same frames."""
    described = {name: {**each.about["data"]} for name, each in figures.items()}
    first = next(iter(described))
    for name, data in described.items():
        for what, value in data.items():
            if value != described[first][what]:
                raise InputError(
                    f"figures of {name}: {what}: expected {described[first][what]!s:.60}, as those of {first} were"
                    f" measured on, found {value!s:.60}; measure both on the same frames"
                )
