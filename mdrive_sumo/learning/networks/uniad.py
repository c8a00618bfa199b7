"""UniadNetwork: counterpart of UniAD: tracking, motion, occupancy and planning in sequence on bird's-eye queries."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.bev_memory import BevMemory
from mdrive_sumo.learning.networks.heads import BOX_NUMBERS, FUTURE_NUMBERS, AgentsHead, OccupancyHead, PlanHead
from mdrive_sumo.learning.networks.occupancy_planner import OccupancyPlanner
from mdrive_sumo.learning.networks.surround_encoder import BevTokens, SurroundEncoder

DETECTED = 1 + BOX_NUMBERS + FUTURE_NUMBERS
"""Numbers that tracking and motion hand on for each cell."""


class UniadNetwork(nn.Module):
    """Six cameras. Each task sees what the tasks before it found; the planner avoids the occupancy it expects."""

    def __init__(self, spec: SystemSpec) -> None:
        super().__init__()
        self.see = SurroundEncoder(spec)
        self.memory = BevMemory()
        self.agents = AgentsHead()
        self.occupancy = OccupancyHead(BEV_CHANNELS + DETECTED)
        self.tokens = BevTokens(inputs=2 * BEV_CHANNELS + DETECTED)
        self.plan = PlanHead(uses_route=False)
        self.avoid = OccupancyPlanner()

    def encode(self, inputs: dict[str, Tensor]) -> Tensor:
        """Return what is remembered of a decision: bird's-eye features (batch, BEV_CHANNELS, cells, cells)."""
        return self.see(inputs)[0]

    def forward(self, inputs: dict[str, Tensor], with_auxiliary: bool = False) -> dict[str, Tensor]:
        """Return `plan`, `bev`; with_auxiliary the plan before its correction, and what the auxiliary losses judge."""
        bev, front = self.see(inputs)
        mixed, memory = self.memory(bev, inputs["memory"], inputs["motion"])
        features, centres, boxes = self.agents(mixed)
        detected = torch.cat((torch.sigmoid(centres), boxes), dim=1)
        occupancy = self.occupancy(torch.cat((features, detected), dim=1))
        tokens = self.tokens(torch.cat((mixed, features, detected), dim=1))
        plan = self.plan(torch.cat((tokens, front), dim=1), inputs["navigation"])
        if with_auxiliary:
            return {"plan": plan, "bev": memory, "centres": centres, "boxes": boxes, "occupancy": occupancy}
        return {"plan": self.avoid(plan, torch.sigmoid(occupancy.float())), "bev": memory}
