"""Losses are zero for the right answer, and grow with what is wrong."""

import numpy as np
import pytest
import torch

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.learning.networks.bev_grid import BEV_CELLS
from mdrive_sumo.learning.networks.heads import BOX_NUMBERS, FUTURE_NUMBERS
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training.losses import (
    _build_targets,
    compute_agents_loss,
    compute_collision_loss,
    compute_lane_loss,
    compute_map_loss,
    measure_offset,
    unpack_occupancy,
)

SAMPLES = {name: torch.from_numpy(values) for name, values in build_synthetic_arrays(SYSTEMS["vad"], 4, seed=1).items()}


def test_bits_unpack_as_numpy_packs_them() -> None:
    maps = np.random.default_rng(0).integers(0, 2, (2, 7, 64, 64), dtype=np.uint8)
    packed = torch.from_numpy(np.packbits(maps.reshape(2, -1), axis=1))
    assert np.array_equal(unpack_occupancy(packed).numpy(), maps)


def box_ahead(x: float, y: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """A standing car, and the room for another one that is not there."""
    boxes = torch.full((1, 2, 9), torch.nan)
    boxes[0, 0] = torch.tensor((x, y, 0.0, 4.0, 2.0, 0.0, 0.0, 1.0, 0.0))
    futures = torch.full((1, 2, 6, 3), torch.nan)
    futures[0, 0] = torch.tensor((x, y, 0.0))
    return boxes, futures


def test_a_plan_through_a_car_costs_and_a_plan_beside_it_does_not() -> None:
    plan = torch.stack((torch.linspace(2, 12, 6), torch.zeros(6)), dim=-1)[None].requires_grad_()
    expert = torch.zeros(1, 6, 2)
    through = compute_collision_loss(plan, expert, *box_ahead(12.5))
    assert through.item() > 0.5
    through.backward()
    assert plan.grad is not None and float(plan.grad[0, -1, 0]) > 0  # towards standing before it
    assert not torch.isnan(plan.grad).any()
    assert compute_collision_loss(plan, expert, *box_ahead(12.0, 4.0)).item() == 0.0


def test_where_the_expert_goes_costs_nothing() -> None:
    plan = torch.stack((torch.linspace(2, 12, 6), torch.zeros(6)), dim=-1)[None]
    assert float(compute_collision_loss(plan, plan, *box_ahead(12.0))) == 0.0


@pytest.mark.parametrize(("aside", "cost"), [(0.5, 0.0), (3.0, 2.15), (-3.0, 2.15)])
def test_leaving_the_lane_costs(aside: float, cost: float) -> None:
    route = SAMPLES["route"][:1]
    plan = torch.stack((torch.linspace(2, 12, 6), torch.full((6,), aside)), dim=-1)[None]
    assert float(compute_lane_loss(plan, torch.zeros(1, 6, 2), route)) == pytest.approx(cost, abs=0.01)
    assert measure_offset(plan, route) == pytest.approx(abs(aside), abs=0.01)


def test_the_right_boxes_cost_less_than_wrong_ones() -> None:
    boxes, futures = box_ahead(12.0, 1.0)
    row, column = int((36 - 12) / 1.5), int((24 - 1) / 1.5)
    cell = torch.full((1, 2), row * BEV_CELLS + column)
    targets, known = _build_targets(boxes, futures, cell)
    assert known[0, 0].all() and not known[0, 1].any()
    centres = torch.full((1, 1, BEV_CELLS, BEV_CELLS), -9.0)
    numbers = torch.zeros(1, BOX_NUMBERS + FUTURE_NUMBERS, BEV_CELLS, BEV_CELLS)
    blind = compute_agents_loss(centres, numbers, boxes, futures)
    centres[0, 0, row, column] = 9.0
    numbers[0, :, row, column] = targets[0, 0]
    right = compute_agents_loss(centres, numbers, boxes, futures)
    assert float(right) < 0.01 < float(blind)
    numbers[0, 0, row, column] += 1.0
    assert float(compute_agents_loss(centres, numbers, boxes, futures)) > float(right)


def test_lanes_that_are_there_cost_least() -> None:
    lanes = SAMPLES["lane_graph"][:1]
    lines = torch.full((1, 12, 10, 2), 18.0)
    lines[0, :2] = lanes[0, :2]
    lines[0, 2:] = lanes[0, 0]
    scores = torch.full((1, 12), 9.0)
    right = compute_map_loss(lines, scores, lanes)
    assert float(right) < 0.01
    assert float(compute_map_loss(lines + 3.0, scores, lanes)) > float(right)
    assert torch.isfinite(compute_map_loss(lines, scores, torch.full_like(lanes, torch.nan)))
