"""warp_maps: maps of senders in the frame of the receiver."""

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CELL_M, FEATURE_CELLS, GRID_REACH_M


def warp_maps(maps: Tensor, pose: Tensor) -> Tensor:
    """Return maps (M, C, FEATURE_CELLS, FEATURE_CELLS) of senders' frames in the receiver's frame; bilinear, 0 outside.

    pose: (M, 3) x, y [m], yaw [rad] of each sender in the receiver's frame.
    """
    offsets = (
        GRID_REACH_M - (torch.arange(FEATURE_CELLS, device=pose.device, dtype=torch.float32) + 0.5) * FEATURE_CELL_M
    )
    x, y, yaw = (each[:, None, None] for each in pose.to(torch.float32).unbind(dim=-1))
    cos, sin = torch.cos(yaw), torch.sin(yaw)
    ahead, left = offsets[None, :, None] - x, offsets[None, None, :] - y
    # Place of each cell in the sender's frame; grid_sample counts columns and rows from -1 to 1, left and ahead to 1.
    column = -(cos * left - sin * ahead) / GRID_REACH_M
    row = -(cos * ahead + sin * left) / GRID_REACH_M
    # In single precision, also where the rest computes in bfloat16: its 8 bits would place cells 0.2 m wrong.
    place = torch.stack((column, row), dim=-1)
    return functional.grid_sample(maps.to(torch.float32), place, align_corners=False).to(maps.dtype)
