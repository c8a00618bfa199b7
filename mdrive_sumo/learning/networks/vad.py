"""VadNetwork: counterpart of VAD: vectorised agents and map elements, their interaction, a constrained plan."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import ROUTE_POINTS, SystemSpec
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.bev_memory import BevMemory
from mdrive_sumo.learning.networks.blocks import AttentionLayer
from mdrive_sumo.learning.networks.heads import (
    WAY_SIZE,
    AgentQueries,
    AgentsHead,
    MapHead,
    OccupancyHead,
    build_plan_head,
    describe_way,
    scale_route,
)
from mdrive_sumo.learning.networks.surround_encoder import BevTokens, SurroundEncoder


class VadNetwork(nn.Module):
    """Six cameras and the route as vectors; collisions and the lane's edge are constraints of the loss."""

    def __init__(self, spec: SystemSpec, plan_head: str) -> None:
        super().__init__()
        self.see = SurroundEncoder(spec)
        self.memory = BevMemory()
        self.tokens = BevTokens()
        self.agents = AgentsHead()
        self.queries = AgentQueries()
        self.map = MapHead()
        self.interact = nn.ModuleList([AttentionLayer(), AttentionLayer()])
        self.plan = build_plan_head(plan_head, WAY_SIZE + 4 * ROUTE_POINTS, BEV_CHANNELS)
        self.occupancy = OccupancyHead()

    def encode(self, inputs: dict[str, Tensor]) -> Tensor:
        """Return what is remembered of a decision: bird's-eye features (batch, BEV_CHANNELS, cells, cells)."""
        return self.see(inputs)[0]

    def forward(self, inputs: dict[str, Tensor], with_auxiliary: bool = False) -> dict[str, Tensor]:
        """Return the plan, `bev`, and with_auxiliary what the auxiliary losses judge."""
        bev, front = self.see(inputs)
        mixed, memory = self.memory(bev, inputs["memory"], inputs["motion"])
        tokens = self.tokens(mixed)
        features, centres, boxes = self.agents(mixed)
        agents = self.queries(features, centres, boxes)
        lanes, lines, is_lane = self.map(tokens)
        elements = torch.cat((agents, lanes), dim=1)
        for layer in self.interact:
            elements = layer(elements, elements)
        scene = torch.cat((elements, tokens, front), dim=1)
        goal = torch.cat((describe_way(inputs), scale_route(inputs["route"])), dim=-1)
        answer = self.plan(scene, goal, mixed, with_auxiliary) | {"bev": memory}
        if with_auxiliary:
            answer |= {"centres": centres, "boxes": boxes, "lines": lines, "is_lane": is_lane}
            answer["occupancy"] = self.occupancy(mixed)
        return answer
