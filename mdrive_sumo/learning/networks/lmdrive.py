"""LmdriveNetwork: counterpart of LMDrive: cameras, LiDAR and an instruction in English."""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import COMMANDS, NAVIGATION_SIZE, SystemSpec
from mdrive_sumo.learning.networks.agents_head import AgentsHead
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer, ConvBlock
from mdrive_sumo.learning.networks.lidar_encoder import LidarEncoder
from mdrive_sumo.learning.networks.occupancy_head import OccupancyHead
from mdrive_sumo.learning.networks.plan_head import PlanHead
from mdrive_sumo.learning.networks.surround_encoder import BevTokens, SurroundEncoder
from mdrive_sumo.learning.networks.text_encoder import TextEncoder


class LmdriveNetwork(nn.Module):
    """Visual tokens and the words of the instruction; the command of navigation is hidden: the words replace it."""

    without_command: Tensor

    def __init__(self, spec: SystemSpec) -> None:
        super().__init__()
        self.see = SurroundEncoder(spec)
        self.lidar = LidarEncoder()
        self.fuse = ConvBlock(2 * BEV_CHANNELS, BEV_CHANNELS)
        self.tokens = BevTokens()
        self.text = TextEncoder()
        self.read = AttentionLayer()
        self.plan = PlanHead(uses_route=False, extra_inputs=WIDTH)
        self.agents = AgentsHead()
        self.occupancy = OccupancyHead()
        mask = torch.ones(NAVIGATION_SIZE)
        mask[1 : 1 + len(COMMANDS)] = 0.0
        self.register_buffer("without_command", mask, persistent=False)

    def forward(self, inputs: dict[str, Tensor], with_auxiliary: bool = False) -> dict[str, Tensor]:
        """Return `plan`; with_auxiliary what the auxiliary losses judge."""
        cameras, front = self.see(inputs)
        bev = self.fuse(torch.cat((cameras, self.lidar(inputs["lidar"])), dim=1))
        words, instruction = self.text(inputs["instruction"])
        scene = self.read(torch.cat((self.tokens(bev), front), dim=1), words)
        navigation = inputs["navigation"] * self.without_command
        answer = {"plan": self.plan(torch.cat((scene, words), dim=1), navigation, instruction)}
        if with_auxiliary:
            _, answer["centres"], answer["boxes"] = self.agents(bev)
            answer["occupancy"] = self.occupancy(bev)
        return answer
