"""Error profiles of object detectors: recall, accuracy and latency for visible objects.

No detector runs here. "ideal" sees everything exactly; the others are SURROGATES: statistical error models whose free
parameters (`recall` and `spread`) were fitted so that `tools/detector_calibration.py` agrees
with published figures. Only that agreement is claimed. Everything else in them (how errors grow with distance, false
positives, heading and speed errors) is an assumption, named as such in docs/detections.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import Float

FAR_M = 100.0
"""Distance [m] at which `recall_far` holds, and radius within which `false_positives` are counted."""


@dataclass(frozen=True, slots=True)
class DetectionProfile:
    """Errors of one detector. Angles in radians; standard deviations are of Gaussian errors."""

    recall: float
    """Probability in [0, 1] of detecting a near, fully visible object."""
    recall_far: float
    """Factor in [0, 1] on recall at `FAR_M`; recall falls linearly with distance."""
    min_visible: float
    """Visible share below which nothing is detected."""
    plain_visible: float
    """Visible share from which on recall is full; below, recall is proportional to the share."""
    spread: float
    """Standard deviation of positions of near objects, along and across the line of sight [m]."""
    spread_doubles_m: float
    """Distance at which position errors are twice those near the sensor; they grow linearly."""
    yaw_sigma: float
    size_sigma: float
    """Relative: 0.05 is 5 percent of length and of width."""
    speed_sigma: float
    """[m/s]"""
    false_positives: float
    """Expected number per frame within `FAR_M`; they have the size of a car."""
    latency_ticks: int
    """Ticks between measurement and output."""

    def recall_at(self, distance: Float, visible: Float) -> Float:
        """Return the detection probability (N,) at distances (N,) [m] with visible shares (N,)."""
        far = np.maximum(1.0 - (1.0 - self.recall_far) * distance / FAR_M, 0.0)
        plain = np.clip(visible / max(self.plain_visible, 1e-9), 0.0, 1.0)
        return np.where(visible >= self.min_visible, self.recall * far * plain, 0.0)

    def spread_at(self, distance: Float) -> Float:
        """Return the standard deviation (N,) [m] of each position coordinate at distances (N,) [m]."""
        return self.spread * (1.0 + distance / self.spread_doubles_m)


class PublishedPrecision(NamedTuple):
    """Average precision that a paper reports."""

    ap50: float
    """At an intersection over union of 0.5, in [0, 1]."""
    ap70: float
    source: str


IDEAL = "ideal"
STANDARD = "standard"
"""Not a profile of its own: the detector of the episode's sensing profile, which `Briefing.standard_detector` names."""
LIDAR_SINGLE = "lidar-single"
V2X_VIT = "Xu et al., V2X-ViT, ECCV 2022 (arXiv:2203.10638), table 1, V2XSet, perfect setting, row {}"
OPENCOOD = "README of github.com/DerrickXuNu/OpenCOOD, 3D detection on V2XSet, LiDAR track, perfect setting, row CoBEVT"


def _build_surrogate(recall: float, spread: float) -> DetectionProfile:
    """Return a profile with fitted recall and spread; all other values are the same assumption for all."""
    return DetectionProfile(
        recall=recall,
        recall_far=0.9,
        min_visible=0.1,
        plain_visible=0.25,
        spread=spread,
        spread_doubles_m=100.0,
        yaw_sigma=0.02,
        size_sigma=0.03,
        speed_sigma=0.5,
        false_positives=0.5,
        latency_ticks=2,
    )


# Recall and spread result from `fit_profile` of `tools/detector_calibration.py` for `PUBLISHED` with seed 0.
PROFILES: Mapping[str, DetectionProfile] = MappingProxyType(
    {
        IDEAL: DetectionProfile(1.0, 1.0, 0.1, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0),
        "lidar-single": _build_surrogate(0.941, 0.128),
        "attfuse": _build_surrogate(0.914, 0.101),
        "disconet": _build_surrogate(0.955, 0.101),
        "fcooper": _build_surrogate(0.949, 0.105),
        "cobevt": _build_surrogate(0.963, 0.109),
    }
)

PUBLISHED: Mapping[str, PublishedPrecision] = MappingProxyType(
    {
        "lidar-single": PublishedPrecision(0.606, 0.402, V2X_VIT.format("No Fusion")),
        "attfuse": PublishedPrecision(0.807, 0.664, V2X_VIT.format("OPV2V (attentive fusion)")),
        "disconet": PublishedPrecision(0.844, 0.695, V2X_VIT.format("DiscoNet")),
        "fcooper": PublishedPrecision(0.840, 0.680, V2X_VIT.format("F-Cooper")),
        "cobevt": PublishedPrecision(0.849, 0.660, OPENCOOD),
    }
)
"""What the surrogates are fitted to. All but "lidar-single" fuse what several vehicles sense."""
