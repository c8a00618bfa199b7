"""LmdriveNetwork: counterpart of LMDrive: cameras, LiDAR and an instruction in English.

The text encoder is trained from scratch on generated instructions.
"""

import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import (
    COMMANDS,
    INSTRUCTION_WORDS,
    LIDAR_LAYERS,
    SystemSpec,
)
from mdrive_sumo.learning.networks.bev_grid import BEV_CHANNELS
from mdrive_sumo.learning.networks.blocks import WIDTH, AttentionLayer, ConvBlock, ResidualBlock
from mdrive_sumo.learning.networks.heads import WAY_SIZE, AgentsHead, OccupancyHead, build_plan_head, describe_way
from mdrive_sumo.learning.networks.surround_encoder import BevTokens, SurroundEncoder

EMBEDDED_WORDS = 256
"""Room for the vocabulary of `agents.learned.instructions`."""


class TextEncoder(nn.Module):
    """Words with their places, two layers of attention among them, the mean over the words that are there."""

    def __init__(self) -> None:
        super().__init__()
        self.words = nn.Embedding(EMBEDDED_WORDS, WIDTH)
        self.places = nn.Parameter(0.1 * torch.randn(INSTRUCTION_WORDS, WIDTH))
        self.layers = nn.ModuleList([AttentionLayer(), AttentionLayer()])

    def forward(self, words: Tensor) -> tuple[Tensor, Tensor]:
        """Return tokens (batch, INSTRUCTION_WORDS, WIDTH) and their mean (batch, WIDTH); words: numbers, 0: padding."""
        is_word = (words > 0)[..., None].to(self.places.dtype)
        tokens = (self.words(words) + self.places) * is_word
        for layer in self.layers:
            tokens = layer(tokens, tokens)
        return tokens, (tokens * is_word).sum(dim=1) / is_word.sum(dim=1).clamp(min=1.0)


class LidarEncoder(nn.Module):
    """Three convolutions, from 64 x 64 to 32 x 32 cells."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            ConvBlock(LIDAR_LAYERS, 16), ConvBlock(16, BEV_CHANNELS, stride=2), ResidualBlock(BEV_CHANNELS)
        )

    def forward(self, counts: Tensor) -> Tensor:
        """Return features (batch, BEV_CHANNELS, cells, cells) of counts (batch, LIDAR_LAYERS, 64, 64) of points."""
        return self.layers(torch.log1p(counts.to(torch.float32)))


class LmdriveNetwork(nn.Module):
    """Visual tokens and the words of the instruction; the command of navigation is hidden: the words replace it."""

    without_command: Tensor

    def __init__(self, spec: SystemSpec, plan_head: str) -> None:
        super().__init__()
        self.see = SurroundEncoder(spec)
        self.lidar = LidarEncoder()
        self.fuse = ConvBlock(2 * BEV_CHANNELS, BEV_CHANNELS)
        self.tokens = BevTokens()
        self.text = TextEncoder()
        self.read = AttentionLayer()
        self.plan = build_plan_head(plan_head, WAY_SIZE + WIDTH, BEV_CHANNELS)
        self.agents = AgentsHead()
        self.occupancy = OccupancyHead()
        mask = torch.ones(WAY_SIZE)
        mask[1 : 1 + len(COMMANDS)] = 0.0
        self.register_buffer("without_command", mask, persistent=False)

    def forward(self, inputs: dict[str, Tensor], with_auxiliary: bool = False) -> dict[str, Tensor]:
        """Return the plan; with_auxiliary what the auxiliary losses judge."""
        cameras, front = self.see(inputs)
        bev = self.fuse(torch.cat((cameras, self.lidar(inputs["lidar"])), dim=1))
        words, instruction = self.text(inputs["instruction"])
        scene = self.read(torch.cat((self.tokens(bev), front), dim=1), words)
        goal = torch.cat((describe_way(inputs) * self.without_command, instruction), dim=-1)
        answer = self.plan(torch.cat((scene, words), dim=1), goal, bev, with_auxiliary)
        if with_auxiliary:
            _, answer["centres"], answer["boxes"] = self.agents(bev)
            answer["occupancy"] = self.occupancy(bev)
        return answer
