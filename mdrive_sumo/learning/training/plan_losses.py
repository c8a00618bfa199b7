"""Losses on plan and control: imitation, collisions, the lane's edge."""

import torch
from torch import Tensor

EGO_HALF_M = (2.5, 1.1)
"""Half length and width of the car with a margin of 0.2 m."""
CAR_HALF_WIDTH_M = 0.9
AXIS_WEIGHTS = (1.0, 2.0)
"""Of errors ahead and to the side: half a metre to the side is another lane's edge, half a metre ahead is nothing."""
CONTROL_WEIGHTS = (1.0, 1.0, 4.0)
"""Of throttle, brake, steer: steering is small, and decides where the car goes."""


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
    start, end = route[:, None, :-1, :2], route[:, None, 1:, :2]
    along = end - start
    step = points[:, :, None] - start
    share = (step * along).sum(dim=-1) / ((along * along).sum(dim=-1) + 1e-6)
    gap = step - share.clamp(0.0, 1.0)[..., None] * along
    return torch.sqrt((gap * gap).sum(dim=-1).amin(dim=-1) + 1e-6)
