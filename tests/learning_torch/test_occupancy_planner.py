"""The planner slows down where the network expects others, and only there."""

import torch

from mdrive_sumo.learning.networks.bev_grid import BEV_AHEAD_M, BEV_LEFT_M
from mdrive_sumo.learning.networks.heads import sample_occupancy
from mdrive_sumo.learning.networks.uniad import OccupancyPlanner

PLAN = torch.stack((torch.arange(1, 7) * 4.0, torch.zeros(6)), dim=-1)[None]


def occupy(x: float, y: float, size: float = 1.5) -> torch.Tensor:
    """Occupancy (1, 7, 64, 64) of a square at all times."""
    rows = BEV_AHEAD_M - 0.75 * (torch.arange(64) + 0.5)
    columns = BEV_LEFT_M - 0.75 * (torch.arange(64) + 0.5)
    inside = ((rows - x).abs() <= size)[:, None] & ((columns - y).abs() <= size)[None]
    return inside.float().expand(1, 7, 64, 64)


def test_occupancy_is_read_where_it_is() -> None:
    maps = occupy(15.0, -6.0)
    x, y = torch.tensor((15.0, 15.0, -40.0)).expand(1, 7, 3), torch.tensor((-6.0, 6.0, 0.0)).expand(1, 7, 3)
    assert sample_occupancy(maps, x, y)[0, 3].tolist() == [1.0, 0.0, 0.0]


def test_a_free_way_leaves_the_plan_as_it_is() -> None:
    for maps in (torch.zeros(1, 7, 64, 64), occupy(15.0, 8.0)):
        assert torch.allclose(OccupancyPlanner()(PLAN, maps), PLAN, atol=0.02)


def test_a_car_in_the_way_is_not_reached() -> None:
    plan = OccupancyPlanner()(PLAN, occupy(20.0, 0.0))
    assert 3.0 < float(plan[0, -1, 0]) < 16.5
    assert float(plan[0, :, 1].abs().max()) == 0.0


def test_each_sample_is_judged_alone() -> None:
    maps = torch.cat((torch.zeros(1, 7, 64, 64), occupy(14.0, 0.0)))
    plans = OccupancyPlanner()(PLAN.expand(2, -1, -1), maps)
    assert torch.allclose(plans[:1], PLAN, atol=0.02) and float(plans[1, -1, 0]) < 12.0
