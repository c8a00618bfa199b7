"""OccupancyPlanner: slow down along the plan where the network expects other road users."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS
from mdrive_sumo.learning.networks.heads import sample_occupancy

PACES = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.1, 0.0)
"""Candidates: the same path, driven at so much of the planned speed."""
FOOTPRINT_M = ((2.2, 0.8), (2.2, -0.8), (0.0, 0.9), (0.0, -0.9), (-2.2, 0.8), (-2.2, -0.8), (3.5, 0.0))
"""Points of the car's box, ahead and left [m], and one before it."""
CLEAR = 0.6
"""Probability of occupancy up to which a place counts as free; training weights occupied cells fourfold, so a true
probability of 0.27."""
SHARPNESS = 0.003
"""Difference in cost at which the better candidate counts e times as much."""
SLOWNESS_COST = 0.12
"""Cost of a candidate of pace 0; of the mean probability above CLEAR along the plan."""


class OccupancyPlanner(nn.Module):
    """Take the candidate with the least cost: what it would hit, and how much it falls behind the plan.

    Nearly equal ones are averaged, so that rounding does not decide; all lie on one path.
    """

    spread: Tensor
    slowness: Tensor

    def __init__(self) -> None:
        super().__init__()
        spread = torch.zeros(len(PACES), PLAN_POINTS, PLAN_POINTS + 1)
        for i, pace in enumerate(PACES):
            for k in range(PLAN_POINTS):
                place = pace * (k + 1)
                low = min(int(place), PLAN_POINTS - 1)
                spread[i, k, low] = 1.0 - (place - low)
                spread[i, k, low + 1] = place - low
        self.register_buffer("spread", spread, persistent=False)
        slowness = torch.tensor([SLOWNESS_COST * (1.0 - pace) for pace in PACES])
        self.register_buffer("slowness", slowness, persistent=False)

    def forward(self, plan: Tensor, occupancy: Tensor) -> Tensor:
        """Return the plan (batch, PLAN_POINTS, 2) to follow.

        occupancy: probabilities (batch, 1 + PLAN_POINTS, cells, cells), now first.
        """
        whole = torch.cat((torch.zeros_like(plan[:, :1]), plan), dim=1)
        candidates = torch.matmul(self.spread, whole[:, None])
        headings = torch.matmul(self.spread, find_headings(whole)[:, None])
        hits = [measure_hits(candidates[:, i], headings[:, i], occupancy) for i in range(len(PACES))]
        cost = torch.stack(hits, dim=1) + self.slowness
        share = torch.softmax(-cost / SHARPNESS, dim=1)
        return (candidates * share[:, :, None, None]).sum(dim=1)


def find_headings(points: Tensor) -> Tensor:
    """Return directions (batch, n, 2) of a path (batch, n, 2) at its points; straight ahead where it stands."""
    steps = points[:, 1:] - points[:, :-1]
    steps = torch.cat((steps[:, :1], steps), dim=1)
    steps = steps + steps.new_tensor((0.05, 0.0))
    return steps / torch.sqrt((steps * steps).sum(dim=-1, keepdim=True) + 1e-6)


def measure_hits(plan: Tensor, headings: Tensor, occupancy: Tensor) -> Tensor:
    """Return (batch,) the mean over the plan's times of the highest probability above CLEAR under the car's box."""
    ahead, left = plan.new_tensor(FOOTPRINT_M).unbind(dim=-1)
    cos, sin = headings[..., 0:1], headings[..., 1:2]
    x = plan[..., 0:1] + cos * ahead - sin * left
    y = plan[..., 1:2] + sin * ahead + cos * left
    found = sample_occupancy(occupancy[:, 1:], x, y)
    return torch.relu(found.amax(dim=-1) - CLEAR).mean(dim=-1)
