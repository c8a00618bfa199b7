"""BevMemory: the bird's-eye features of the last two decisions, moved to where the car is now.

What a network remembers of a decision is what it saw then, before it was mixed with older memory: so training on pairs
of decisions shows it the same memory that it has while driving, however long the drive.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.learning.networks.bev_grid import (
    BEV_AHEAD_M,
    BEV_AREA_M,
    BEV_CELLS,
    BEV_CHANNELS,
    BEV_LEFT_M,
    compute_cell_centres,
)
from mdrive_sumo.learning.networks.blocks import ConvBlock, ResidualBlock

REMEMBERED = 2
"""Decisions in the memory; the network compares the present with the older one, 0.4 s ago."""
MEMORY_SHAPE = (REMEMBERED, BEV_CHANNELS, BEV_CELLS, BEV_CELLS)


class BevMemory(nn.Module):
    """Mix the present features with those of two decisions ago."""

    centres: Tensor

    def __init__(self) -> None:
        super().__init__()
        centres = torch.from_numpy(compute_cell_centres()).to(torch.float32)
        self.register_buffer("centres", centres, persistent=False)
        self.mix = nn.Sequential(ConvBlock(2 * BEV_CHANNELS, BEV_CHANNELS), ResidualBlock(BEV_CHANNELS))

    def forward(self, bev: Tensor, memory: Tensor, motion: Tensor) -> tuple[Tensor, Tensor]:
        """Return mixed features (batch, BEV_CHANNELS, cells, cells) and the memory for the next decision.

        bev: what the cameras show now. memory: (batch, *MEMORY_SHAPE), newest first, as the previous decision left it.
        motion: (batch, 3) dx, dy [m, the car's frame then], change of yaw [rad] since that decision.
        """
        moved = warp_memory(memory.to(bev.dtype), motion, self.centres)
        mixed = self.mix(torch.cat((bev, moved[:, 1]), dim=1))
        return mixed, torch.stack((bev, moved[:, 0]), dim=1)


def warp_memory(memory: Tensor, motion: Tensor, centres: Tensor) -> Tensor:
    """Return memory (batch, K, channels, cells, cells) as seen from the car after a motion (batch, 3), zeros outside.

    centres: (cells, cells, 2) of the grid [m, ego frame].
    """
    cos, sin = torch.cos(motion[:, 2]), torch.sin(motion[:, 2])
    x, y = centres[..., 0], centres[..., 1]
    then_x = cos[:, None, None] * x - sin[:, None, None] * y + motion[:, 0, None, None]
    then_y = sin[:, None, None] * x + cos[:, None, None] * y + motion[:, 1, None, None]
    place = torch.stack(to_grid(then_x, then_y), dim=-1)
    moved = functional.grid_sample(memory.flatten(1, 2).float(), place.float(), align_corners=False)
    return moved.unflatten(1, memory.shape[1:3]).to(memory.dtype)


def to_grid(x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Return column and row of x, y [m, ego frame] on a bird's-eye map, in [-1, 1] as `grid_sample` counts them."""
    return (BEV_LEFT_M - y) * (2.0 / BEV_AREA_M) - 1.0, (BEV_AHEAD_M - x) * (2.0 / BEV_AREA_M) - 1.0


def halve_motion(motion: Tensor) -> Tensor:
    """Return the motion (batch, 3) that, done twice, is `motion`: two decisions of equal length and curvature."""
    quarter = motion[:, 2] / 4
    cos, sin = torch.cos(quarter), torch.sin(quarter)
    x, y = motion[:, 0], motion[:, 1]
    scale = 1.0 / (2.0 * cos)
    return torch.stack(((cos * x + sin * y) * scale, (cos * y - sin * x) * scale, motion[:, 2] / 2), dim=-1)
