"""Auxiliary losses: what a network should see (occupancy, road users, lanes, its own speed)."""

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.agents.learned.system_spec import LIDAR_CELLS
from mdrive_sumo.learning.networks.agents_head import BOX_NUMBERS
from mdrive_sumo.learning.networks.bev_grid import AHEAD_M, BEV_AREA_M, BEV_CELL_M, BEV_CELLS, LEFT_M
from mdrive_sumo.learning.networks.map_head import MAP_SCALE_M
from mdrive_sumo.learning.networks.occupancy_head import TIMES
from mdrive_sumo.learning.sample_format import VISIBLE

OCCUPIED_WEIGHT = 4.0
"""Of occupied cells, which are few."""
CENTRE_WEIGHT = 8.0
NEAR_LANE_M = 2.0
"""[m] Mean distance up to which a predicted lane is a true one."""


def unpack_occupancy(packed: Tensor) -> Tensor:
    """Return maps (batch, TIMES, LIDAR_CELLS, LIDAR_CELLS) float32 of packed bits (batch, bytes), as numpy.packbits."""
    shifts = torch.arange(7, -1, -1, device=packed.device, dtype=torch.uint8)
    bits = torch.bitwise_right_shift(packed[..., None], shifts) & 1
    return bits.flatten(1).unflatten(1, (TIMES, LIDAR_CELLS, LIDAR_CELLS)).to(torch.float32)


def compute_occupancy_loss(logits: Tensor, packed: Tensor) -> Tensor:
    """Return the cross entropy of occupancy, occupied cells weighted."""
    weight = logits.new_tensor(OCCUPIED_WEIGHT, dtype=torch.float32)
    return functional.binary_cross_entropy_with_logits(logits.float(), unpack_occupancy(packed), pos_weight=weight)


def compute_agents_loss(centres: Tensor, numbers: Tensor, boxes: Tensor, futures: Tensor) -> Tensor:
    """Return the loss of the centres' map and of boxes and futures at the cells that hold a visible road user's centre.

    centres: (batch, 1, cells, cells) logits. numbers: (batch, BOX_NUMBERS + FUTURE_NUMBERS, cells, cells).
    boxes: (batch, N, 9), futures: (batch, N, n, 3), NaN where there is none.
    """
    row = torch.floor((AHEAD_M - boxes[..., 0]) / BEV_CELL_M)
    column = torch.floor((LEFT_M - boxes[..., 1]) / BEV_CELL_M)
    is_inside = (row >= 0) & (row < BEV_CELLS) & (column >= 0) & (column < BEV_CELLS)  # false where NaN
    is_target = is_inside & (boxes[..., VISIBLE] > 0.5)
    cell = torch.where(is_target, row * BEV_CELLS + column, 0.0).long()
    heat = torch.zeros_like(centres[:, 0].flatten(1), dtype=torch.float32)
    heat.scatter_reduce_(1, cell, is_target.float(), "amax")
    weight = heat.new_tensor(CENTRE_WEIGHT)
    found = functional.binary_cross_entropy_with_logits(centres.flatten(1).float(), heat, pos_weight=weight)
    cells = numbers.flatten(2).transpose(1, 2).float()
    answers = cells.gather(1, cell[..., None].expand(-1, -1, cells.shape[-1]))
    targets, is_known = _build_targets(boxes, futures, cell)
    error = (answers - targets).abs() * (is_known & is_target[..., None])
    return found * 10.0 + error.sum() / (is_target.sum() * answers.shape[-1] + 1.0)


def _build_targets(boxes: Tensor, futures: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
    """Return numbers (batch, N, ...) as AgentsHead answers them, and where they are known."""
    centre_x = AHEAD_M - (torch.div(cell, BEV_CELLS, rounding_mode="floor") + 0.5) * BEV_CELL_M
    centre_y = LEFT_M - (cell % BEV_CELLS + 0.5) * BEV_CELL_M
    x, y, yaw, length, width, speed = boxes[..., :6].unbind(dim=-1)
    now = (x - centre_x, y - centre_y, torch.cos(yaw), torch.sin(yaw), length / 5.0, width / 5.0, speed / 10.0)
    ahead = (futures[..., :2] - boxes[:, :, None, :2]).flatten(2) / 10.0
    targets = torch.cat((torch.stack(now, dim=-1), ahead), dim=-1)
    assert len(now) == BOX_NUMBERS
    return torch.nan_to_num(targets), ~torch.isnan(targets)


def compute_map_loss(lines: Tensor, logits: Tensor, lanes: Tensor) -> Tensor:
    """Return the loss of predicted lanes: each true lane's distance from the nearest, and whether each is near one.

    lines: (batch, Q, points, 2) [m]. logits: (batch, Q). lanes: (batch, L, points, 2) [m], NaN where there is none.
    """
    is_near = (lanes[..., 0] < AHEAD_M) & (lanes[..., 0] > AHEAD_M - BEV_AREA_M) & (lanes[..., 1].abs() < LEFT_M)
    is_lane = is_near.float().mean(dim=-1) > 0.3
    known = torch.nan_to_num(lanes)
    gap = (lines[:, :, None].float() - known[:, None]).abs().mean(dim=(-1, -2))
    gap = gap.masked_fill(~is_lane[:, None], 100.0)
    best = gap.amin(dim=1)
    covered = (best * is_lane).sum() / (is_lane.sum() + 1.0)
    nearest = gap.amin(dim=2)
    score = functional.binary_cross_entropy_with_logits(logits.float(), (nearest.detach() < NEAR_LANE_M).float())
    precise = nearest.clamp(max=20.0).mean()
    return (covered + 0.2 * precise) / MAP_SCALE_M + 0.1 * score


def compute_speed_loss(seen: Tensor, own: Tensor) -> Tensor:
    """Return the L1 distance of the speed seen (batch,) [m/s / 10] from the true one in `own` (batch, 6)."""
    return (seen.float() - own[:, 3] / 10.0).abs().mean()
