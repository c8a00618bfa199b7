"""What a system's answers cost: imitation, collisions, the lane's edge, and auxiliary losses on what it should see.

`compute_losses` weights the parts by one table for all systems; those of scored anchors are in `anchor_losses`.
"""

from collections.abc import Mapping
from types import MappingProxyType

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.agents.learned.system_spec import LIDAR_CELLS
from mdrive_sumo.learning.networks.bev_grid import BEV_AHEAD_M, BEV_AREA_M, BEV_CELL_M, BEV_CELLS, BEV_LEFT_M
from mdrive_sumo.learning.networks.heads import BOX_NUMBERS, MAP_SCALE_M, TIMES
from mdrive_sumo.learning.sample_format import VISIBLE

LOSS_WEIGHTS: Mapping[str, float] = MappingProxyType(
    {
        "plan": 1.0,
        "control": 1.0,
        "collision": 0.3,
        "lane": 0.3,
        "occupancy": 2.0,
        "agents": 0.5,
        "map": 0.3,
        "speed": 0.1,
        "offset": 1.0,
        "choice": 0.5,
        "teacher": 2.0,
    }
)
"""The plan's unit is a metre; the others are scaled to about a tenth up to a half of it after the first steps."""


def compute_losses(answer: Mapping[str, Tensor], batch: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the parts of the loss that the answer of a network without anchors allows; `add_up` weights them."""
    expert = batch["expert_plan"]
    parts: dict[str, Tensor] = {}
    if "plan" in answer:
        parts["plan"] = compute_plan_loss(answer["plan"], expert)
        parts["collision"] = compute_collision_loss(answer["plan"], expert, batch["boxes"], batch["futures"])
        parts["lane"] = compute_lane_loss(answer["plan"], expert, batch["route"])
    if "control" in answer:
        parts["control"] = compute_control_loss(answer["control"], batch["expert_control"])
    if "occupancy" in answer:
        parts["occupancy"] = compute_occupancy_loss(answer["occupancy"], batch["occupancy"])
    if "centres" in answer:
        parts["agents"] = compute_agents_loss(answer["centres"], answer["boxes"], batch["boxes"], batch["futures"])
    if "lines" in answer:
        parts["map"] = compute_map_loss(answer["lines"], answer["is_lane"], batch["lane_graph"])
    if "speed" in answer:
        parts["speed"] = compute_speed_loss(answer["speed"], batch["own"])
    return parts


def add_up(parts: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the parts with their weighted sum as `total`."""
    return {**parts, "total": torch.stack([LOSS_WEIGHTS[name] * part for name, part in parts.items()]).sum()}


EGO_HALF_M = (2.5, 1.1)
"""Half length and width of the car with a margin of 0.2 m."""
CAR_HALF_WIDTH_M = 0.9
AXIS_WEIGHTS = (1.0, 2.0)
"""Weights of errors ahead and to the side: half a metre to the side is another lane's edge, half a metre ahead is
nothing."""
CONTROL_WEIGHTS = (1.0, 1.0, 4.0)
"""Weights of throttle, brake, steer: steering is small, and decides where the car goes."""


def compute_plan_loss(plan: Tensor, expert: Tensor) -> Tensor:
    """Return the mean L1 distance [m] of plans (batch, n, 2), weighted by AXIS_WEIGHTS."""
    return ((plan.float() - expert).abs() * expert.new_tensor(AXIS_WEIGHTS)).mean()


def compute_control_loss(control: Tensor, expert: Tensor) -> Tensor:
    """Return the mean weighted L1 distance of controls (batch, 3)."""
    weights = expert.new_tensor(CONTROL_WEIGHTS)
    return ((control.float() - expert).abs() * weights).mean()


def compute_collision_loss(plan: Tensor, expert: Tensor, boxes: Tensor, futures: Tensor) -> Tensor:
    """Return how deep [m] plans lie in road users' true future boxes, where the expert's own plan is clear of them.

    plan, expert: (batch, n, 2). boxes: (batch, N, 9). futures: (batch, N, n, 3), NaN where there is none.
    """
    depth = _measure_depth(plan.float(), boxes, futures)
    is_clear = _measure_depth(expert, boxes, futures) <= 0.0
    return (depth * is_clear).sum(dim=1).mean()


def _measure_depth(plan: Tensor, boxes: Tensor, futures: Tensor) -> Tensor:
    """Return depths (batch, N, n) of points in boxes that are enlarged by the car's; 0 outside.

    Depth is the way [m] along the box to get out of it, less at its sides: so a plan learns to brake and to give room.
    """
    is_there = ~torch.isnan(futures[..., 0])
    known = torch.nan_to_num(futures)
    size = torch.nan_to_num(boxes[:, :, None, 3:5]) / 2
    step = plan[:, None] - known[..., :2]
    cos, sin = torch.cos(known[..., 2]), torch.sin(known[..., 2])
    along = (cos * step[..., 0] + sin * step[..., 1]).abs()
    aside = (cos * step[..., 1] - sin * step[..., 0]).abs()
    ahead_room = torch.relu(size[..., 0] + EGO_HALF_M[0] - along)
    side_room = torch.relu(size[..., 1] + EGO_HALF_M[1] - aside)
    return ahead_room * side_room.clamp(max=1.0) * is_there


def compute_lane_loss(plan: Tensor, expert: Tensor, route: Tensor) -> Tensor:
    """Return how far [m] plans leave the route's lane, beyond where the expert goes.

    plan, expert: (batch, n, 2). route: (batch, points, 4): x, y, half lane width [m], speed limit.
    """
    room = torch.maximum(measure_offset(expert, route), route[:, :1, 2] - CAR_HALF_WIDTH_M)
    return torch.relu(measure_offset(plan.float(), route) - room).mean()


def measure_offset(points: Tensor, route: Tensor) -> Tensor:
    """Return distances (batch, n) [m] of points (batch, n, 2) from a route's polyline (batch, p, 4)."""
    return project_on_route(points, route)[0]


def project_on_route(points: Tensor, route: Tensor) -> tuple[Tensor, Tensor]:
    """Return distances from a route's polyline (batch, p, 4) and stations on it (batch, n) [m] of points (batch, n, 2).

    Coordinates apart: sums over two numbers take most of the time otherwise.
    """
    x, y = route[:, None, :, 0], route[:, None, :, 1]
    along_x, along_y = torch.diff(x, dim=-1), torch.diff(y, dim=-1)
    squared = along_x * along_x + along_y * along_y
    step_x, step_y = points[:, :, None, 0] - x[..., :-1], points[:, :, None, 1] - y[..., :-1]
    share = ((step_x * along_x + step_y * along_y) / (squared + 1e-6)).clamp(0.0, 1.0)
    gap_x, gap_y = step_x - share * along_x, step_y - share * along_y
    nearest, row = (gap_x * gap_x + gap_y * gap_y).min(dim=-1)
    length = torch.sqrt(squared).expand_as(share)
    before = length.cumsum(dim=-1) - length
    station = before.gather(2, row[..., None]) + (share * length).gather(2, row[..., None])
    return torch.sqrt(nearest + 1e-6), station[..., 0]


OCCUPIED_WEIGHT = 4.0
"""Weight of occupied cells, which are few."""
CENTRE_WEIGHT = 8.0
"""Weight of cells with a centre, which are few."""
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
    row = torch.floor((BEV_AHEAD_M - boxes[..., 0]) / BEV_CELL_M)
    column = torch.floor((BEV_LEFT_M - boxes[..., 1]) / BEV_CELL_M)
    is_inside = (row >= 0) & (row < BEV_CELLS) & (column >= 0) & (column < BEV_CELLS)  # false where NaN
    is_target = is_inside & (boxes[..., VISIBLE] > 0.5)
    cell = torch.where(is_target, row * BEV_CELLS + column, 0.0).long()
    heat = torch.zeros_like(centres[:, 0].flatten(1), dtype=torch.float32)
    heat.scatter_reduce_(1, cell, is_target.float(), "amax")
    weight = heat.new_tensor(CENTRE_WEIGHT)
    loss = functional.binary_cross_entropy_with_logits(centres.flatten(1).float(), heat, pos_weight=weight)
    cells = numbers.flatten(2).transpose(1, 2).float()
    answers = cells.gather(1, cell[..., None].expand(-1, -1, cells.shape[-1]))
    targets, is_known = _build_targets(boxes, futures, cell)
    error = (answers - targets).abs() * (is_known & is_target[..., None])
    return loss * 10.0 + error.sum() / (is_target.sum() * answers.shape[-1] + 1.0)


def _build_targets(boxes: Tensor, futures: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
    """Return numbers (batch, N, ...) as AgentsHead answers them, and where they are known."""
    centre_x = BEV_AHEAD_M - (torch.div(cell, BEV_CELLS, rounding_mode="floor") + 0.5) * BEV_CELL_M
    centre_y = BEV_LEFT_M - (cell % BEV_CELLS + 0.5) * BEV_CELL_M
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
    is_near = (
        (lanes[..., 0] < BEV_AHEAD_M) & (lanes[..., 0] > BEV_AHEAD_M - BEV_AREA_M) & (lanes[..., 1].abs() < BEV_LEFT_M)
    )
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
