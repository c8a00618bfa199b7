"""PointEncoder: a point grid to a map of features in the car's own frame, and how confident it is where."""

from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CHANNELS, GRID_LAYERS
from mdrive_sumo.learning.networks.blocks import ConvBlock, ResidualBlock

HALF, QUARTER, EIGHTH = 24, 48, 96
"""Channels at 0.8, 1.6 and 3.2 m: see docs/fusion-frames.md for the price of a scan."""
RARE_LOGIT = -4.0
"""Of a fresh network everywhere: 2 % of cells hold something."""


class PointEncoder(nn.Module):
    """A small residual network with one step down and up again, so that a cell of 1.6 m knows the 20 m around it."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Sequential(ConvBlock(GRID_LAYERS, HALF, stride=2), ConvBlock(HALF, QUARTER, stride=2))
        self.fine = ResidualBlock(QUARTER)
        self.coarse = nn.Sequential(
            ConvBlock(QUARTER, EIGHTH, stride=2),
            ResidualBlock(EIGHTH),
            ResidualBlock(EIGHTH),
            nn.Conv2d(EIGHTH, QUARTER, 1),
        )
        self.merge = ConvBlock(QUARTER, QUARTER)
        self.narrow = ConvBlock(QUARTER, FEATURE_CHANNELS, size=1)
        self.confidence = nn.Conv2d(FEATURE_CHANNELS, 1, 1)
        assert self.confidence.bias is not None
        nn.init.constant_(self.confidence.bias, RARE_LOGIT)

    def forward(self, grid: Tensor) -> tuple[Tensor, Tensor]:
        """Encode point grids (M, GRID_LAYERS, GRID_CELLS, GRID_CELLS), ln(1 + count) as `expand_cells` has them.

        Returns features (M, FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), none below 0 so that empty cells cost no
        bytes, and logits (M, FEATURE_CELLS, FEATURE_CELLS) that a road user's centre is there.
        """
        fine = self.fine(self.stem(grid))
        raised = functional.interpolate(self.coarse(fine), scale_factor=2.0, mode="nearest")
        features = self.narrow(self.merge(fine + raised))
        return features, self.confidence(features)[:, 0]
