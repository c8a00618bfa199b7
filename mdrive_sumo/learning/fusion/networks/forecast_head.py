"""ForecastHead: how likely each cell is occupied now and at later times, from fused features and known road users."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CHANNELS, FORECAST_S
from mdrive_sumo.learning.fusion.networks.point_encoder import RARE_LOGIT
from mdrive_sumo.learning.networks.blocks import ConvBlock, ResidualBlock

FINE, HALF, QUARTER = 32, 64, 96
"""Channels at 1.6, 3.2 and 6.4 m: a place must know what can reach it in 3 s, at 14 m/s from 42 m."""
OUTPUT_WIDTH = 16
"""Channels at 0.8 m."""
TRACK_LOGIT = 5.0
"""Added at first where a known road user would be at constant velocity: with RARE_LOGIT 0.73. It is trained."""


class ForecastHead(nn.Module):
    """Corrects the motion of known road users at constant velocity, and adds what is not known yet."""

    def __init__(self) -> None:
        super().__init__()
        times = len(FORECAST_S)
        self.mix = ConvBlock(FEATURE_CHANNELS + 4 * times, FINE)
        self.down = ConvBlock(FINE, HALF, stride=2)
        self.coarse = nn.Sequential(
            ConvBlock(HALF, QUARTER, stride=2), ResidualBlock(QUARTER), nn.Conv2d(QUARTER, HALF, 1)
        )
        self.middle = nn.Sequential(ResidualBlock(HALF), nn.Conv2d(HALF, FINE, 1))
        self.fine = ResidualBlock(FINE)
        self.widen = ConvBlock(FINE, 4 * OUTPUT_WIDTH, size=1)
        self.answer = nn.Conv2d(OUTPUT_WIDTH, times, 3, padding=1)
        self.track_gain = nn.Parameter(torch.full((times, 1, 1), TRACK_LOGIT))
        assert self.answer.bias is not None
        nn.init.constant_(self.answer.bias, RARE_LOGIT)

    def forward(self, fused: Tensor, tracks: Tensor) -> Tensor:
        """Return logits (F, times, OUTPUT_CELLS, OUTPUT_CELLS) that a cell is occupied at FORECAST_S.

        fused: (F, FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS). tracks: (F, times, OUTPUT_CELLS, OUTPUT_CELLS) 1
        where a known road user would be at constant velocity, else 0.
        """
        fine = self.mix(torch.cat((fused, functional.pixel_unshuffle(tracks, 2)), dim=1))
        middle = self.down(fine)
        middle = middle + functional.interpolate(self.coarse(middle), scale_factor=2.0, mode="nearest")
        fine = fine + functional.interpolate(self.middle(middle), scale_factor=2.0, mode="nearest")
        raised = functional.pixel_shuffle(self.widen(self.fine(fine)), 2)
        return self.answer(raised) + self.track_gain * tracks
