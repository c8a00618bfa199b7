"""AnchorHead: scores and offsets of all plan anchors, from what lies under each of them and from a few tokens."""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.plan_anchors import ANCHORS, SCORES, PlanAnchors, build_anchors
from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Int
from mdrive_sumo.learning.networks.bev_grid import BEV_AHEAD_M, BEV_CELL_M, BEV_CELLS, BEV_LEFT_M
from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer, Mlp

ANCHOR_WIDTH = 48
"""Length of an anchor's query: less than of other tokens, because weights are at most 3 MB."""
LOCAL_CHANNELS = 16
"""Of the bird's-eye features that are read under an anchor."""
LOOKED_AT_M = (0.0, 3.0)
"""[m] Ahead of the box centre at each point of an anchor: under the car, and before its bumper."""
LEAST_OFFSET_M, OFFSET_SHARE = 1.0, 0.05
"""An offset is at most so long, and longer by that share of the way to the anchor's point: the next anchor lies at most
1.2 m away within 30 m, and 3.2 m at 100 m."""
POINT_SCALE_M = 20.0


class AnchorHead(nn.Module):
    """Each anchor is a query: its shape and the grid's features on it; queries look at latent tokens, not at others."""

    numbers: Tensor
    cells: Tensor
    reach: Tensor

    def __init__(self, channels: int) -> None:
        """channels: of the bird's-eye features."""
        super().__init__()
        anchors = build_anchors()
        self.register_buffer("cells", torch.from_numpy(_index_cells(anchors)).int(), persistent=False)
        reach = portable.hypot(anchors.points[..., 0].ravel(), anchors.points[..., 1].ravel())
        reach_m = LEAST_OFFSET_M + OFFSET_SHARE * reach.reshape(ANCHORS, PLAN_POINTS, 1)
        numbers = np.concatenate(((anchors.points / POINT_SCALE_M).reshape(ANCHORS, -1), anchors.yaws), axis=1)
        self.register_buffer("numbers", torch.from_numpy(numbers).float(), persistent=False)
        self.register_buffer("reach", torch.from_numpy(reach_m).float(), persistent=False)
        self.shape = Mlp(numbers.shape[1], ANCHOR_WIDTH, ANCHOR_WIDTH)
        self.thin = nn.Conv2d(channels, LOCAL_CHANNELS, 1)
        self.local = nn.Linear(LOCAL_CHANNELS * len(LOOKED_AT_M) * PLAN_POINTS, ANCHOR_WIDTH)
        self.tokens = nn.Linear(WIDTH, ANCHOR_WIDTH)
        self.look = AttentionLayer(ANCHOR_WIDTH)
        self.score = nn.Sequential(nn.LayerNorm(ANCHOR_WIDTH), nn.Linear(ANCHOR_WIDTH, len(SCORES)))
        self.offset = nn.Sequential(nn.LayerNorm(ANCHOR_WIDTH), Mlp(ANCHOR_WIDTH, ANCHOR_WIDTH, 2 * PLAN_POINTS))

    def forward(self, tokens: Tensor, maps: Tensor, with_logits: bool = False) -> dict[str, Tensor]:
        """Return `anchor_scores` (batch, ANCHORS, len(SCORES)), `anchor_offsets` (batch, ANCHORS, PLAN_POINTS, 2) [m].

        tokens: (batch, T, WIDTH), few: what the plan is about. maps: (batch, channels, cells, cells).
        with_logits: `anchor_logits`, which losses need, instead of scores.
        """
        # In single precision: the gradient of a cell is a sum over many anchors, which 8 bits of bfloat16 do not hold.
        thin = functional.pad(self.thin(maps).float().flatten(2), (0, 1))
        under = thin.index_select(2, self.cells).unflatten(2, (ANCHORS, -1)).permute(0, 2, 3, 1).flatten(2)
        queries = self.look(self.shape(self.numbers) + self.local(under), self.tokens(tokens))
        logits = self.score(queries).float()
        offsets = torch.tanh(self.offset(queries).float()).unflatten(2, (PLAN_POINTS, 2)) * self.reach
        if with_logits:
            return {"anchor_logits": logits, "anchor_offsets": offsets}
        chosen = functional.log_softmax(logits[..., :1], dim=1)
        scores = torch.cat((chosen, functional.logsigmoid(logits[..., 1:])), dim=-1)
        return {"anchor_scores": scores, "anchor_offsets": offsets}


def _index_cells(anchors: PlanAnchors) -> Int:
    """Return the cell (ANCHORS * places,) of each place that anchors look at; outside one more, which is empty."""
    cos, sin = portable.cos_sin(anchors.yaws)
    places = [anchors.points + ahead_m * np.stack((cos, sin), axis=-1) for ahead_m in LOOKED_AT_M]
    places_xy = np.stack(places, axis=2).reshape(ANCHORS, -1, 2)
    row = np.floor((BEV_AHEAD_M - places_xy[..., 0]) / BEV_CELL_M).astype(np.int64)
    column = np.floor((BEV_LEFT_M - places_xy[..., 1]) / BEV_CELL_M).astype(np.int64)
    is_inside = (row >= 0) & (row < BEV_CELLS) & (column >= 0) & (column < BEV_CELLS)
    return np.where(is_inside, row * BEV_CELLS + column, BEV_CELLS * BEV_CELLS).ravel()
