"""AgentsHead: road users as a map of their centres, boxes and futures (dense, as CenterNet: no matching is needed)."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS
from mdrive_sumo.learning.networks.bev_grid import AHEAD_M, BEV_CELL_M, BEV_CELLS, BEV_CHANNELS, LEFT_M
from mdrive_sumo.learning.networks.blocks import WIDTH, ConvBlock, Mlp, flatten_map

BOX_NUMBERS = 7
"""dx, dy [m, from the cell's centre], cos, sin of the yaw, length, width [m / 5], speed [m/s / 10]."""
FUTURE_NUMBERS = 2 * PLAN_POINTS
"""x, y [m / 10] of the centre at each time of the plan, from where it is now."""
QUERIES = 16


class AgentsHead(nn.Module):
    """A logit for a centre and the numbers of a box in each cell of the grid."""

    def __init__(self, inputs: int = BEV_CHANNELS) -> None:
        super().__init__()
        self.trunk = ConvBlock(inputs, BEV_CHANNELS)
        self.centre = nn.Conv2d(BEV_CHANNELS, 1, 1)
        self.numbers = nn.Conv2d(BEV_CHANNELS, BOX_NUMBERS + FUTURE_NUMBERS, 1)
        assert self.centre.bias is not None
        nn.init.constant_(self.centre.bias, -4.0)

    def forward(self, bev: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return features, logits (batch, 1, cells, cells) and numbers (batch, BOX_NUMBERS + FUTURE_NUMBERS, ...)."""
        features = self.trunk(bev)
        return features, self.centre(features), self.numbers(features)


class AgentQueries(nn.Module):
    """Vectorised agents: one query for each of the QUERIES likeliest centres."""

    centres: Tensor

    def __init__(self) -> None:
        super().__init__()
        rows = torch.arange(BEV_CELLS).repeat_interleave(BEV_CELLS)
        columns = torch.arange(BEV_CELLS).repeat(BEV_CELLS)
        x, y = AHEAD_M - (rows + 0.5) * BEV_CELL_M, LEFT_M - (columns + 0.5) * BEV_CELL_M
        self.register_buffer("centres", torch.stack((x, y), dim=-1) / 10.0, persistent=False)
        self.embed = Mlp(BEV_CHANNELS + BOX_NUMBERS + FUTURE_NUMBERS + 3, WIDTH, WIDTH)

    def forward(self, features: Tensor, logits: Tensor, numbers: Tensor) -> Tensor:
        """Return queries (batch, QUERIES, WIDTH) from what AgentsHead returned."""
        score, cells = logits.flatten(1).topk(QUERIES, dim=1)
        cell_tokens = torch.cat((flatten_map(features), flatten_map(numbers)), dim=-1)
        picked = cell_tokens.gather(1, cells[..., None].expand(-1, -1, cell_tokens.shape[-1]))
        places = self.centres.to(picked.dtype)[cells]
        likely = torch.sigmoid(score)[..., None].to(picked.dtype)
        return self.embed(torch.cat((picked, places, likely), dim=-1)) * likely
