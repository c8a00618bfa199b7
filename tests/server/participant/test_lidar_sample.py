"""The sample agent of the sensor track finds what stands on its route, and what moves towards it, in points alone."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from testing.paths import ROOT

from mdrive_sumo.contract import OwnState
from mdrive_sumo.core.geometry import Float

ROUTE, S = np.column_stack([np.arange(60.0), np.zeros(60)]), np.arange(60.0)
OWN = OwnState(x=5.0, y=0.0, yaw=0.0, speed=5.0, acceleration=0.0, yaw_rate=0.0, steer_angle=0.0)


@pytest.fixture(scope="module")
def obstacles() -> ModuleType:
    path: Path = ROOT / "server" / "samples" / "lidar" / "src" / "obstacles.py"
    spec = importlib.util.spec_from_file_location("lidar_obstacles", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def scan_box(x: float, y: float, above_ground: float = 1.0) -> Float:
    """Points on a box of 4 m x 2 m in the world, in the frame of the sensor; its own pose is `OWN`."""
    along, across = np.meshgrid(np.arange(-2.0, 2.1, 0.5), np.arange(-1.0, 1.1, 0.5))
    points = np.column_stack([along.ravel() + x - OWN.x, across.ravel() + y - OWN.y])
    return np.column_stack([points, np.full(len(points), above_ground - 2.5), np.ones(len(points))])


def find_free_way(obstacles: ModuleType, *scans: Float) -> float:
    finder = obstacles.ObstacleFinder(0.05)
    for number, scan in enumerate(scans):
        finder.update(4 * number, OWN, scan)
    return finder.find_free_way(ROUTE, S, 5.0, 1.5)


def test_it_stops_for_what_stands_on_its_route_and_for_nothing_beside_or_below_it(obstacles: ModuleType) -> None:
    assert find_free_way(obstacles, scan_box(25.0, 0.0)) == pytest.approx(18.0 - 1.5, abs=2.1)
    assert find_free_way(obstacles, scan_box(25.0, 8.0)) == np.inf
    assert find_free_way(obstacles, scan_box(25.0, 0.0, above_ground=0.1)) == np.inf
    assert find_free_way(obstacles, np.zeros((0, 4))) == np.inf


def test_it_stops_for_what_moves_towards_its_route_and_not_for_what_moves_away(obstacles: ModuleType) -> None:
    near, far = scan_box(25.0, 12.0), scan_box(25.0, 14.0)  # 10 m/s between two scans
    assert find_free_way(obstacles, far, near) == pytest.approx(18.0 - 1.5, abs=2.1)
    assert find_free_way(obstacles, near, far) == np.inf


def test_cells_that_touch_are_one_group(obstacles: ModuleType) -> None:
    cells = np.array([(0, 0), (1, 1), (5, 5), (5, 6), (9, 0)])
    groups = obstacles.group_cells(cells)
    assert groups[0] == groups[1] and groups[2] == groups[3] and len(set(groups.tolist())) == 3
