"""judge_plans: what the data set knows about any plan: collisions, the lane, progress, comfort; a teacher of anchors.

It is the simulator's word after the fact: road users do in it what they did in the drive, whatever the plan.
"""

from collections.abc import Mapping

import torch
from torch import Tensor

from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S
from mdrive_sumo.learning.training.losses import CAR_HALF_WIDTH_M, EGO_HALF_M, project_on_route
from mdrive_sumo.scoring.metrics.comfort import BOUNDS

JUDGED = ("collision", "lane", "progress", "comfort")
"""Columns of a judgement, each from 0 (bad) to 1 (good): `plan_anchors.SCORES` without the expert's choice."""
MOVED_M = 0.5
"""[m] A car that has moved less stands, and is not to blame for who drives into it."""
LANE_FADE_M = 1.0
"""[m] Outside of its room a plan is good for nothing. Anchors lie half a metre from what is meant."""
SLACK_M = 1.0
"""[m] Added to both lengths of progress, so that standing plans have a ratio."""
COMFORT_FADE = 4.0
"""[m/s2] Beyond the bounds of comfort: one anchor's pace differs from the next by up to 2 m/s2."""
BEYOND_M = 100.0
"""[m] The last way of a route goes on straight by that much: a plan at 33 m/s is twice as long as a route."""


def judge_plans(plans: Tensor, labels: Mapping[str, Tensor]) -> Tensor:
    """Return (batch, K, len(JUDGED)) in [0, 1] for plans (batch, K, n, 2) [m, ego frame].

    labels: of `TrainingData.take_labels`. What the expert itself does, is allowed.
    - collision: 0 if the car's box overlaps a road user's true future box, checked every half interval, unless that box
      is behind the car, or the car stands (nuPlan's collisions at fault).
    - lane: distance from the route beyond the lane's room, and beyond the expert's.
    - progress: the way along the route, as a share of the expert's, at most 1.
    - comfort: longitudinal and lateral acceleration within nuPlan's bounds, from the present speed on.
    """
    every = torch.cat((plans, labels["expert_plan"][:, None]), dim=1).float()
    hits = find_hits(every, labels["boxes"], labels["futures"])
    outside, way = _follow_route(every, extend_route(labels["route"].float()))
    strain = _measure_strain(every, labels["own"][:, None, 3].float())
    (hits, allowed), (outside, outside_expert), (way, way_expert), (strain, strain_expert) = (
        (each[:, :-1], each[:, -1:]) for each in (hits, outside, way, strain)
    )
    return torch.stack(
        (
            1.0 - (hits & ~allowed).any(dim=-1).float(),
            1.0 - (torch.relu(outside - outside_expert) / LANE_FADE_M).clamp(max=1.0),
            ((way + SLACK_M) / (torch.relu(way_expert) + SLACK_M)).clamp(0.0, 1.0),
            1.0 - (torch.relu(strain - strain_expert) / COMFORT_FADE).clamp(max=1.0),
        ),
        dim=-1,
    )


def find_hits(plans: Tensor, boxes: Tensor, futures: Tensor) -> Tensor:
    """Return which road users (batch, K, N) plans (batch, K, n, 2) collide with by their own fault.

    boxes: (batch, N, 9), futures: (batch, N, n, 3), NaN where there is none. The car's box has a margin of 0.2 m.
    """
    path = torch.cat((torch.zeros_like(plans[:, :, :1]), plans), dim=2)
    step = path[:, :, 1:] - path[:, :, :-1]
    moved = torch.linalg.vector_norm(step, dim=-1).cumsum(dim=-1)
    aim = step + step.new_tensor((0.05, 0.0))  # who stands looks ahead
    heading = aim / torch.linalg.vector_norm(aim, dim=-1, keepdim=True).clamp(min=1e-6)
    poses = torch.cat((boxes[:, :, None, :3], futures), dim=2)
    facing = torch.stack((torch.cos(poses[..., 2]), torch.sin(poses[..., 2])), dim=-1)
    half = boxes[:, None, :, 3:5] / 2.0
    # All times at once, as one long batch: in a loop they were 2 100 of the 4 700 operations of a step of `vad`.
    place, way = _interpolate(poses[..., :2]), _interpolate(facing)
    way = way / torch.linalg.vector_norm(way, dim=-1, keepdim=True).clamp(min=1e-6)
    times = place.shape[2] // plans.shape[2]
    overlap, is_behind = _overlap(
        _interpolate(path).transpose(1, 2).flatten(0, 1),
        heading.repeat_interleave(times, dim=2).transpose(1, 2).flatten(0, 1),
        place.transpose(1, 2).flatten(0, 1),
        way.transpose(1, 2).flatten(0, 1),
        half.expand(-1, place.shape[2], -1, -1).flatten(0, 1)[:, None],
    )
    overlap, is_behind = (each.unflatten(0, (len(plans), -1)) for each in (overlap, is_behind))
    is_moving = (moved > MOVED_M).repeat_interleave(times, dim=2).transpose(1, 2)[..., None]
    excused = overlap & is_behind  # it drove into the car from behind, and goes on through it
    for time in range(1, excused.shape[1]):
        excused[:, time] |= excused[:, time - 1]
    return (overlap & ~excused & is_moving).any(dim=1)


def _interpolate(path: Tensor) -> Tensor:
    """Return the middles and ends (batch, K, 2 n, 2) of the steps of paths (batch, K, n + 1, 2)."""
    middle = torch.lerp(path[:, :, :-1], path[:, :, 1:], 0.5)
    return torch.stack((middle, path[:, :, 1:]), dim=3).flatten(2, 3)


def _overlap(centre: Tensor, heading: Tensor, place: Tensor, facing: Tensor, half: Tensor) -> tuple[Tensor, Tensor]:
    """Return where the car's boxes (batch, K) overlap others (batch, N), and whose centre is behind (batch, K, N).

    Separating axes of oriented boxes; false where a number is NaN.
    """
    step = place[:, None] - centre[:, :, None]
    own, other = heading[:, :, None], facing[:, None]
    cos = (own * other).sum(dim=-1).abs()
    sin = (own[..., 0] * other[..., 1] - own[..., 1] * other[..., 0]).abs()
    ahead = (step * own).sum(dim=-1)
    aside = (own[..., 0] * step[..., 1] - own[..., 1] * step[..., 0]).abs()
    along = (step * other).sum(dim=-1).abs()
    across = (other[..., 0] * step[..., 1] - other[..., 1] * step[..., 0]).abs()
    length, width = half.unbind(dim=-1)
    own_length, own_width = EGO_HALF_M
    is_overlap = (
        (ahead.abs() <= own_length + cos * length + sin * width)
        & (aside <= own_width + sin * length + cos * width)
        & (along <= length + cos * own_length + sin * own_width)
        & (across <= width + sin * own_length + cos * own_width)
    )
    return is_overlap, ahead < -own_length


def extend_route(route: Tensor) -> Tensor:
    """Return routes (batch, p + 1, 4) that go on straight. Points are repeated beyond a goal: the last way counts."""
    step = route[:, 1:, :2] - route[:, :-1, :2]
    length = torch.linalg.vector_norm(step, dim=-1)
    order = torch.arange(length.shape[1], device=route.device)
    last = torch.where(length > 0.1, order, 0).amax(dim=1)
    rows = torch.arange(len(route), device=route.device)
    direction = step[rows, last] / length[rows, last].clamp(min=1e-3)[:, None]
    end = route[:, -1:].clone()
    end[:, 0, :2] += BEYOND_M * direction
    return torch.cat((route, end), dim=1)


def _follow_route(plans: Tensor, route: Tensor) -> tuple[Tensor, Tensor]:
    """Return how far plans lie outside of the lane at their worst point, and their way along it (batch, K) [m]."""
    offset, station = (each.unflatten(1, plans.shape[1:3]) for each in project_on_route(plans.flatten(1, 2), route))
    return torch.relu(offset.amax(dim=-1) - (route[:, :1, 2] - CAR_HALF_WIDTH_M)), station[..., -1]


def _measure_strain(plans: Tensor, speed: Tensor) -> Tensor:
    """Return by how much (batch, K) [m/s2] plans exceed the bounds of acceleration; speed: now (batch, 1) [m/s]."""
    path = torch.cat((torch.zeros_like(plans[:, :, :1]), plans), dim=2)
    step = path[:, :, 1:] - path[:, :, :-1]
    paces = torch.linalg.vector_norm(step, dim=-1) / PLAN_INTERVAL_S
    # The first pace is that of the middle of its interval; half of the interval is too short to derive by.
    gain = torch.diff(paces, dim=-1, prepend=speed[..., None].expand(*paces.shape[:2], 1)) / PLAN_INTERVAL_S
    cross = step[:, :, :-1, 0] * step[:, :, 1:, 1] - step[:, :, :-1, 1] * step[:, :, 1:, 0]
    turn = torch.atan2(cross, (step[:, :, :-1] * step[:, :, 1:]).sum(dim=-1))
    lateral = (turn / PLAN_INTERVAL_S * paces[:, :, 1:]).abs()
    longitudinal = torch.maximum(
        gain - BOUNDS.max_longitudinal_acceleration, BOUNDS.min_longitudinal_acceleration - gain
    )
    worst = torch.maximum(longitudinal.amax(dim=-1), lateral.amax(dim=-1) - BOUNDS.max_lateral_acceleration)
    return torch.relu(worst)
