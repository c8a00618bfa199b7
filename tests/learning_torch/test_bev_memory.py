"""Memory moves with the car."""

import math

import pytest
import torch

from mdrive_sumo.learning.networks.bev_grid import (
    BEV_AHEAD_M,
    BEV_CELL_M,
    BEV_CELLS,
    BEV_CHANNELS,
    BEV_LEFT_M,
    compute_cell_centres,
)
from mdrive_sumo.learning.networks.bev_memory import MEMORY_SHAPE, BevMemory, halve_motion, warp_memory
from mdrive_sumo.learning.training.predict_samples import recall_previous

CENTRES = torch.from_numpy(compute_cell_centres()).float()


def find_peak(maps: torch.Tensor) -> tuple[float, float]:
    """x, y [m] of the centre of mass of a map (cells, cells)."""
    weight = maps / maps.sum()
    return float((weight * CENTRES[..., 0]).sum()), float((weight * CENTRES[..., 1]).sum())


def mark(x: float, y: float) -> torch.Tensor:
    """Memory (1, 1, 1, cells, cells) with one cell of 1."""
    maps = torch.zeros(1, 1, 1, BEV_CELLS, BEV_CELLS)
    maps[..., int((BEV_AHEAD_M - x) / BEV_CELL_M), int((BEV_LEFT_M - y) / BEV_CELL_M)] = 1.0
    return maps


@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (1.0, -0.5, 0.0), (2.0, 0.3, 0.3)])
def test_what_stands_stays_where_it_is_in_the_world(motion: tuple[float, float, float]) -> None:
    then = find_peak(mark(12.0, 6.0)[0, 0, 0])
    now = find_peak(warp_memory(mark(12.0, 6.0), torch.tensor([motion]), CENTRES)[0, 0, 0])
    dx, dy, turn = motion
    x, y = then[0] - dx, then[1] - dy
    expected = math.cos(turn) * x + math.sin(turn) * y, math.cos(turn) * y - math.sin(turn) * x
    assert now == pytest.approx(expected, abs=0.3)


def test_half_a_motion_twice_is_the_motion() -> None:
    motion = torch.tensor([[3.0, 0.5, 0.6], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    half = halve_motion(motion)
    cos, sin = torch.cos(half[:, 2]), torch.sin(half[:, 2])
    x = half[:, 0] + cos * half[:, 0] - sin * half[:, 1]
    y = half[:, 1] + sin * half[:, 0] + cos * half[:, 1]
    assert torch.stack((x, y, 2 * half[:, 2]), dim=-1) == pytest.approx(motion, abs=1e-5)


class Eyes(torch.nn.Module):
    """A network that remembers the map it is given."""

    def encode(self, inputs: dict[str, torch.Tensor]) -> torch.Tensor:
        return inputs["map"]


def test_training_shows_the_memory_of_two_decisions() -> None:
    """Memory as training builds it from a pair of samples is what two decisions in a row leave."""
    torch.manual_seed(0)
    memory = BevMemory().eval()
    first, second, third = (torch.rand(1, BEV_CHANNELS, BEV_CELLS, BEV_CELLS) for _ in range(3))
    motion = torch.tensor([[4.0, 0.4, 0.2]])
    half = halve_motion(motion)
    _, left = memory(first, torch.zeros(1, *MEMORY_SHAPE), torch.zeros(1, 3))
    _, left = memory(second, left, half)
    driven, _ = memory(third, left, half)
    recalled = recall_previous(Eyes(), {"map": first}, motion, torch.ones(1, dtype=torch.bool))
    trained, _ = memory(third, recalled["memory"], recalled["motion"])
    assert torch.allclose(driven, trained, atol=1e-5)
    forgotten = recall_previous(Eyes(), {"map": first}, motion, torch.zeros(1, dtype=torch.bool))
    assert float(forgotten["memory"].abs().max()) == 0.0
