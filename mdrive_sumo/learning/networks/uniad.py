"""UniadNetwork: counterpart of UniAD: tracking, motion, occupancy and planning in sequence on bird's-eye queries.

The plan slows down where the network expects other road users.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS, SystemSpec
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.bev_memory import BevMemory
from mdrive_sumo.learning.networks.heads import (
    BOX_NUMBERS,
    FINER,
    FUTURE_NUMBERS,
    TIMES,
    WAY_SIZE,
    AgentsHead,
    OccupancyHead,
    build_plan_head,
    describe_way,
    sample_occupancy,
)
from mdrive_sumo.learning.networks.surround_encoder import BevTokens, SurroundEncoder

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


DETECTED = 1 + BOX_NUMBERS + FUTURE_NUMBERS
"""Numbers that tracking and motion hand on for each cell."""


class UniadNetwork(nn.Module):
    """Six cameras. Each task sees what the tasks before it found; the planner avoids the occupancy it expects.

    Waypoints are slowed down where it lies; anchors look at it.
    """

    def __init__(self, spec: SystemSpec, plan_head: str) -> None:
        super().__init__()
        self.see = SurroundEncoder(spec)
        self.memory = BevMemory()
        self.agents = AgentsHead()
        self.occupancy = OccupancyHead(BEV_CHANNELS + DETECTED)
        self.tokens = BevTokens(inputs=2 * BEV_CHANNELS + DETECTED)
        self.plan = build_plan_head(plan_head, WAY_SIZE, BEV_CHANNELS + TIMES * FINER * FINER)
        self.avoid = OccupancyPlanner()

    def encode(self, inputs: dict[str, Tensor]) -> Tensor:
        """Return what is remembered of a decision: bird's-eye features (batch, BEV_CHANNELS, cells, cells)."""
        return self.see(inputs)[0]

    def forward(self, inputs: dict[str, Tensor], with_auxiliary: bool = False) -> dict[str, Tensor]:
        """Return the plan, `bev`; with_auxiliary the plan before its correction, and what losses judge."""
        bev, front = self.see(inputs)
        mixed, memory = self.memory(bev, inputs["memory"], inputs["motion"])
        features, centres, boxes = self.agents(mixed)
        detected = torch.cat((torch.sigmoid(centres), boxes), dim=1)
        occupancy = self.occupancy(torch.cat((features, detected), dim=1))
        tokens = self.tokens(torch.cat((mixed, features, detected), dim=1))
        expected = torch.sigmoid(occupancy.float())
        maps = torch.cat((features, functional.pixel_unshuffle(expected, FINER).to(features.dtype)), dim=1)
        answer = self.plan(torch.cat((tokens, front), dim=1), describe_way(inputs), maps, with_auxiliary)
        if with_auxiliary:
            return answer | {"bev": memory, "centres": centres, "boxes": boxes, "occupancy": occupancy}
        if "plan" in answer:
            answer["plan"] = self.avoid(answer["plan"], expected)
        return answer | {"bev": memory}
