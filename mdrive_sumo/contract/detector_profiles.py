"""Error profiles of object detectors: how often, how exactly and how late they see what is in sight.

No detector runs here. "ideal" sees everything exactly; the others are SURROGATES: statistical error models whose free
parameters (`recall` and `spread`) were fitted so that the average precision that `precision.measured_ap` finds agrees
with published figures. Only that agreement is claimed. Everything else in them (how errors grow with distance, false
positives, heading and speed errors) is an assumption, named as such in docs/sensors.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.geometry import Float

FAR_M = 100.0
"""Where `recall_far` holds and `false_positives` are counted within."""


@dataclass(frozen=True, slots=True)
class DetectionProfile:
    """What goes wrong in one detector. Angles in radians; standard deviations are of Gaussian errors."""

    recall: float
    """Probability in [0, 1] to find something near and wholly visible."""
    recall_far: float
    """Factor in [0, 1] by which recall has shrunk, in proportion to distance, at `FAR_M`."""
    min_visible: float
    """Visible share below which nothing is found."""
    plain_visible: float
    """Visible share from which on more does not help; recall grows in proportion up to there."""
    spread: float
    """Of positions, along and across the line of sight, of something near [m]."""
    spread_doubles_m: float
    """Distance at which errors of position are twice as large as near; they grow in proportion to distance."""
    yaw_sigma: float
    size_sigma: float
    """Relative: 0.05 is 5 percent of length and of width."""
    speed_sigma: float
    """[m/s]"""
    false_positives: float
    """Expected number at a time within `FAR_M` all around; they have the size of a car."""
    latency_ticks: int
    """How many ticks later it is told what was seen."""

    def recall_at(self, distance: Float, visible: Float) -> Float:
        """(N,) probability to find things at a distance [m] whose shares `visible` are in sight."""
        far = np.maximum(1.0 - (1.0 - self.recall_far) * distance / FAR_M, 0.0)
        plain = np.clip(visible / max(self.plain_visible, 1e-9), 0.0, 1.0)
        return np.where(visible >= self.min_visible, self.recall * far * plain, 0.0)

    def spread_at(self, distance: Float) -> Float:
        """(N,) standard deviation [m] of each coordinate of the position of things at a distance [m]."""
        return self.spread * (1.0 + distance / self.spread_doubles_m)


class PublishedPrecision(NamedTuple):
    """Average precision that a paper reports."""

    ap50: float
    """At an intersection over union of 0.5, in [0, 1]."""
    ap70: float
    source: str


IDEAL = "ideal"
LIDAR_SINGLE = "lidar-single"
V2X_VIT = "Xu et al., V2X-ViT, ECCV 2022 (arXiv:2203.10638), table 1, V2XSet, perfect setting, row {}"
OPENCOOD = "README of github.com/DerrickXuNu/OpenCOOD, 3D detection on V2XSet, LiDAR track, perfect setting, row CoBEVT"


def _surrogate(recall: float, spread: float) -> DetectionProfile:
    """Profiles differ in what was fitted; the rest is the same plausible assumption for all."""
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


# Recall and spread are what `precision.fitted` finds for `PUBLISHED` with seed 0.
PROFILES: Mapping[str, DetectionProfile] = MappingProxyType(
    {
        IDEAL: DetectionProfile(1.0, 1.0, 0.1, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0),
        "lidar-single": _surrogate(0.941, 0.128),
        "attfuse": _surrogate(0.914, 0.101),
        "disconet": _surrogate(0.955, 0.101),
        "fcooper": _surrogate(0.949, 0.105),
        "cobevt": _surrogate(0.963, 0.109),
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
