"""LidarEncoder: the histogram of a LiDAR scan to features on the bird's-eye grid."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import LIDAR_LAYERS
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.blocks import ConvBlock, ResidualBlock


class LidarEncoder(nn.Module):
    """Three convolutions, from 64 x 64 to 32 x 32 cells."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            ConvBlock(LIDAR_LAYERS, 16), ConvBlock(16, BEV_CHANNELS, stride=2), ResidualBlock(BEV_CHANNELS)
        )

    def forward(self, counts: Tensor) -> Tensor:
        """Return features (batch, BEV_CHANNELS, cells, cells) of counts (batch, LIDAR_LAYERS, 64, 64) of points."""
        return self.layers(torch.log1p(counts.to(torch.float32)))
