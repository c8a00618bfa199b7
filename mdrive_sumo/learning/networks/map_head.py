"""MapHead: centre lines of lanes as a few polylines (vectorised map elements)."""

import torch
from torch import Tensor, nn

from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer, Mlp
from mdrive_sumo.learning.sample_format import LANE_POINTS

MAP_QUERIES = 12
MAP_SCALE_M = 10.0


class MapHead(nn.Module):
    """Learned queries look at the bird's-eye tokens; each answers one polyline and whether there is such a lane."""

    def __init__(self) -> None:
        super().__init__()
        self.queries = nn.Parameter(torch.randn(MAP_QUERIES, WIDTH))
        self.look = AttentionLayer()
        self.lines = Mlp(WIDTH, WIDTH, 2 * LANE_POINTS + 1)

    def forward(self, tokens: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return queries (batch, MAP_QUERIES, WIDTH), lines (..., LANE_POINTS, 2) [m, ego frame] and logits (...)."""
        queries = self.look(self.queries.expand(tokens.shape[0], -1, -1), tokens)
        answer = self.lines(queries)
        lines = answer[..., :-1].unflatten(-1, (LANE_POINTS, 2)) * MAP_SCALE_M
        return queries, lines, answer[..., -1]
