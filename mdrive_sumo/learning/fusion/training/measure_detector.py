"""measure_detector: average precisions of a trained detector under all conditions, channels and budgets."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from mdrive_sumo.agents.learned.fusion_spec import FUSIONS
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.detector_figures import DetectorFigures, describe_frames
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.sharing_channels import BUDGETS, CHANNELS
from mdrive_sumo.learning.fusion.training.channel_detection import (
    detect_over_channels,
    has_maps,
    measure_point_bytes,
)
from mdrive_sumo.learning.fusion.training.detect_frames import detect_frames
from mdrive_sumo.learning.fusion.training.export_fusion import build_trained_network
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore
from mdrive_sumo.learning.training.checkpoint import load_checkpoint


def name_trained(detector: str) -> str:
    """Return the detector whose weights a detector takes."""
    return "none" if detector == "late" else detector


def measure_detector(
    detector: str, checkpoint: Path, frames: FusionFrames, device: torch.device, report: Callable[[str], object]
) -> DetectorFigures:
    """Return the figures of a detector (also `late`) with the weights of a checkpoint. Raises InputError."""
    torch.backends.cudnn.benchmark = False  # frames have any number of senders: as in training
    loaded = load_checkpoint(checkpoint, name_trained(detector))
    network = build_trained_network(loaded).to(device, memory_format=torch.channels_last)
    store = FrameStore(frames, device)
    about: dict[str, Any] = {
        "data": describe_frames(frames),
        "checkpoint": str(checkpoint),
        "steps": loaded.step,
        "training": loaded.summary,
    }
    figures = DetectorFigures(detector, about)
    is_late = detector == "late"
    for condition in CONDITIONS:
        if detector == "none" and condition is not CONDITIONS[0]:
            figures.repeat(condition.name, CONDITIONS[0].name)
            continue
        figures.add(frames, condition.name, detect_frames(network, frames, store, condition, is_late))
        report(f"{detector}: {condition.name}")
    if detector == "early":
        figures.repeat("ideal", CONDITIONS[0].name)
        figures.use["ideal"] = {"map_bytes": measure_point_bytes(frames)}
    elif detector == "none":
        for channel in (*CHANNELS, *BUDGETS):
            figures.repeat(channel.name, CONDITIONS[0].name)
    if has_maps(detector):
        channels = (*CHANNELS, *BUDGETS) if detector in FUSIONS else CHANNELS
        for name, detected in detect_over_channels(network, frames, store, channels, is_late).items():
            figures.add(frames, name, detected.found)
            figures.use[name] = detected.use.describe()
            report(f"{detector}: {name}")
    return figures
