"""FusionNetwork: encoder, fusion and head of a detector; all detectors share encoder and head."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, SHARING, check_detector
from mdrive_sumo.learning.fusion.networks.detection_head import DetectionHead, compute_scores
from mdrive_sumo.learning.fusion.networks.forecast_head import ForecastHead
from mdrive_sumo.learning.fusion.networks.fusions import FUSION_MODULES, FusionGate, split_cars
from mdrive_sumo.learning.fusion.networks.point_encoder import PointEncoder
from mdrive_sumo.learning.fusion.networks.warp import warp_maps

AGE_SCALE_S = 0.3
"""The oldest scan of a frame."""


class FusionAnswer(NamedTuple):
    """What a detector answers of F frames."""

    heat: Tensor
    """Logits (F, classes, OUTPUT_CELLS, OUTPUT_CELLS)."""
    numbers: Tensor
    """(F, BOX_NUMBERS, OUTPUT_CELLS, OUTPUT_CELLS)"""
    fit: Tensor
    """Logits (F, OUTPUT_CELLS, OUTPUT_CELLS)."""
    fused: Tensor
    """(F, FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS)"""

    @property
    def scores(self) -> Tensor:
        """(F, classes, OUTPUT_CELLS, OUTPUT_CELLS) in [0, 1]"""
        return compute_scores(self.heat, self.fit)


class FusionNetwork(nn.Module):
    """A detector. Raises InputError for a name that has no weights.

    is_gated: whether a gate decides, for each cell, how much of the fusion is taken; only of SHARING.
    """

    def __init__(self, detector: str, is_gated: bool = False) -> None:
        super().__init__()
        check_detector(detector)
        self.detector = detector
        self.encoder = PointEncoder()
        self.fusion = FUSION_MODULES[detector]() if detector in SHARING else nn.Identity()
        self.gate = FusionGate() if is_gated and detector in SHARING else None
        self.head = DetectionHead()
        self.forecast = ForecastHead() if detector == CODRIVING else None

    def forward(self, features: Tensor, arrived: Tensor, pose: Tensor, age: Tensor) -> FusionAnswer:
        """Fuse maps of F frames with N cars each and detect; car 0 is the receiver, which has the pose 0, 0, 0.

        features: (F, N, FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), each in the frame of its car. arrived: (F, N,
        FEATURE_CELLS, FEATURE_CELLS) 1 where a cell arrived, else 0. pose: (F, N, 3) x, y [m], yaw [rad] of each car in
        the receiver's frame. age: (F, N) [s].
        """
        if self.detector not in SHARING:
            return self._detect(features[:, 0])
        maps = torch.cat((features, arrived[:, :, None].to(features.dtype)), dim=2)
        warped = split_cars(warp_maps(maps.flatten(0, 1), pose.flatten(0, 1)), features)
        values, there = warped[:, :, :-1], warped[:, :, -1:]
        ages = (age / AGE_SCALE_S).to(values.dtype)[:, :, None, None, None]
        fused = self.fusion(values, there, ages)
        if self.gate is not None:
            fused = self.gate(values[:, 0], fused, there, ages)
        return self._detect(fused)

    def _detect(self, fused: Tensor) -> FusionAnswer:
        heat, numbers, fit = self.head(fused)
        return FusionAnswer(heat, numbers, fit, fused)
