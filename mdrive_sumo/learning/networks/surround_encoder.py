"""SurroundEncoder: images of a rig to bird's-eye features, and tokens for heads."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.bev_lifting import BevLifting
from mdrive_sumo.learning.networks.blocks import WIDTH, ConvBlock, flatten_map
from mdrive_sumo.learning.networks.image_encoder import SMALL_WIDTHS, ImageEncoder


class SurroundEncoder(nn.Module):
    """One image encoder for all cameras, lifting to the grid, and tokens of the first camera (lights and signs)."""

    def __init__(self, spec: SystemSpec) -> None:
        super().__init__()
        self.names = tuple(image.name for image in spec.images)
        self.encoder = ImageEncoder(SMALL_WIDTHS, BEV_CHANNELS, coarse_blocks=2)
        self.lifting = BevLifting(spec, BEV_CHANNELS)
        self.front = nn.Linear(SMALL_WIDTHS[-1], WIDTH)

    def forward(self, inputs: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Return features (batch, BEV_CHANNELS, cells, cells) and tokens (batch, T, WIDTH) of the first camera."""
        maps = [self.encoder(inputs[name]) for name in self.names]
        return self.lifting([fine for fine, _ in maps]), self.front(flatten_map(maps[0][1][:, 0]))


class BevTokens(nn.Module):
    """Tokens of the bird's-eye features at half their resolution, with a learned place."""

    def __init__(self, cells: int = 16, inputs: int = BEV_CHANNELS) -> None:
        super().__init__()
        self.shrink = ConvBlock(inputs, WIDTH, stride=2)
        self.place = nn.Parameter(0.1 * torch.randn(cells * cells, WIDTH))

    def forward(self, bev: Tensor) -> Tensor:
        """Return tokens (batch, cells * cells, WIDTH) of features (batch, inputs, 2 * cells, 2 * cells)."""
        return flatten_map(self.shrink(bev)) + self.place
