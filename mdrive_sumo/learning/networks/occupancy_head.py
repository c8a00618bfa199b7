"""OccupancyHead: which cells are occupied now and at each time of the plan."""

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.system_spec import LIDAR_CELLS, PLAN_POINTS
from mdrive_sumo.learning.networks.bev_grid import BEV_CELLS, BEV_CHANNELS
from mdrive_sumo.learning.networks.bev_memory import to_grid
from mdrive_sumo.learning.networks.blocks import ConvBlock

TIMES = 1 + PLAN_POINTS
FINER = LIDAR_CELLS // BEV_CELLS


class OccupancyHead(nn.Module):
    """Logits on the 64 x 64 grid from features on the 32 x 32 grid."""

    def __init__(self, inputs: int = BEV_CHANNELS) -> None:
        super().__init__()
        self.layers = nn.Sequential(ConvBlock(inputs, BEV_CHANNELS), nn.Conv2d(BEV_CHANNELS, TIMES * FINER * FINER, 1))
        _start_rare(self.layers[-1])

    def forward(self, bev: Tensor) -> Tensor:
        """Return logits (batch, TIMES, LIDAR_CELLS, LIDAR_CELLS)."""
        return functional.pixel_shuffle(self.layers(bev), FINER)


def _start_rare(layer: nn.Module) -> None:
    """Start with a probability of 5 % everywhere: most cells are empty."""
    assert isinstance(layer, nn.Conv2d) and layer.bias is not None
    nn.init.constant_(layer.bias, -3.0)


def sample_occupancy(occupancy: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Return values (batch, T, P) of maps (batch, T, cells, cells) at places x, y (batch, T, P) [m, ego frame].

    Bilinear; zero outside of the maps.
    """
    column, row = to_grid(x, y)
    batch, times, points = x.shape
    place = torch.stack((column, row), dim=-1).reshape(batch * times, 1, points, 2)
    maps = occupancy.reshape(batch * times, 1, *occupancy.shape[2:])
    return functional.grid_sample(maps, place, align_corners=False).reshape(batch, times, points)
