"""DetectionHead: centres, boxes and how well each box fits, from a map of features."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.fusion_spec import BOX_NUMBERS, CLASSES, FEATURE_CHANNELS
from mdrive_sumo.learning.fusion.networks.point_encoder import RARE_LOGIT
from mdrive_sumo.learning.networks.blocks import ConvBlock, ResidualBlock

WIDTH, FINE_WIDTH = 48, 24
"""Channels at 1.6 and at 0.8 m."""


class DetectionHead(nn.Module):
    """One trunk, raised to cells of 0.8 m, for all classes."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = nn.Sequential(ConvBlock(FEATURE_CHANNELS, WIDTH), ResidualBlock(WIDTH))
        self.widen = ConvBlock(WIDTH, 4 * FINE_WIDTH, size=1)
        self.fine = ConvBlock(FINE_WIDTH, FINE_WIDTH)
        self.heat = nn.Conv2d(FINE_WIDTH, len(CLASSES), 1)
        self.numbers = nn.Conv2d(FINE_WIDTH, BOX_NUMBERS, 1)
        self.fit = nn.Conv2d(FINE_WIDTH, 1, 1)
        assert self.heat.bias is not None
        nn.init.constant_(self.heat.bias, RARE_LOGIT)

    def forward(self, maps: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return logits of centres (F, classes, OUTPUT_CELLS, OUTPUT_CELLS), numbers of boxes (F, BOX_NUMBERS, ...)
        and logits of the expected intersection over union (F, ...)."""
        raised = functional.pixel_shuffle(self.widen(self.trunk(maps)), 2)
        fine = self.fine(raised)
        return self.heat(fine), self.numbers(fine), self.fit(fine)[:, 0]


def compute_scores(heat: Tensor, fit: Tensor) -> Tensor:
    """Return scores (F, classes, ...) of logits: the geometric mean of both probabilities.

    A box that is likely there and badly placed comes behind one that fits (IoU-aware score, Wu et al. 2020).
    """
    return torch.sqrt(torch.sigmoid(heat) * torch.sigmoid(fit)[:, None])
