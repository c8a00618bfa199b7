"""ImageEncoder: images to feature maps of stride 8 and 16."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.learning.networks.blocks import ConvBlock, ResidualBlock

SMALL_WIDTHS = (24, 40, 64, 128)
"""Channels at strides 2, 4, 8 and 16 for six images of 112 x 200: see docs/training.md for its price."""
WIDE_WIDTHS = (32, 48, 80, 160)
"""Channels of the four stages, for a rig of one image."""


class ImageEncoder(nn.Module):
    """A small residual network with a top-down path from stride 16 to stride 8 (feature pyramid).

    It takes bytes as cameras give them and normalises inside, so that the exported network needs no preparation.
    """

    def __init__(self, widths: tuple[int, int, int, int], outputs: int, coarse_blocks: int = 1) -> None:
        super().__init__()
        half, quarter, eighth, sixteenth = widths
        self.stem = nn.Sequential(ConvBlock(3, half, stride=2), ConvBlock(half, quarter, stride=2))
        self.fine = nn.Sequential(ConvBlock(quarter, eighth, stride=2), ResidualBlock(eighth))
        blocks = [ResidualBlock(sixteenth) for _ in range(coarse_blocks)]
        self.coarse = nn.Sequential(ConvBlock(eighth, sixteenth, stride=2), *blocks)
        self.lateral = nn.Conv2d(eighth, outputs, 1)
        self.top_down = nn.Conv2d(sixteenth, outputs, 1)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Encode images (batch, cameras, height, width, 3), bytes or floats 0 to 255.

        Returns maps of stride 8 (batch, cameras, outputs, h, w) and of stride 16 (batch, cameras, widths[3], h, w).
        """
        batch, cameras = images.shape[:2]
        pixels = images.flatten(0, 1).permute(0, 3, 1, 2).to(torch.float32) * (1.0 / 64.0) - 2.0
        fine = self.fine(self.stem(pixels))
        coarse = self.coarse(fine)
        raised = functional.interpolate(self.top_down(coarse), size=fine.shape[-2:], mode="nearest")
        return _split(self.lateral(fine) + raised, batch, cameras), _split(coarse, batch, cameras)


def _split(maps: Tensor, batch: int, cameras: int) -> Tensor:
    return maps.reshape(batch, cameras, *maps.shape[1:])


def count_cells(pixels: int, stride: int) -> int:
    """Return how many cells a map has along a side of so many pixels: convolutions of stride 2 round up."""
    return -(-pixels // stride)
