"""Drawn traffic drives for 30 s in SUMO: no teleport, and no vehicle runs into anything."""

import random
import time
from pathlib import Path

import numpy as np
import pytest
from testing.drawn_drives import drive_drawn, place_roads

from mdrive_sumo.worlds.traffic import draw_traffic, find_demand

pytestmark = pytest.mark.slow
DRIVES = (
    ("crossing", 1, "town-busy"),
    ("crossing", 3, "town-busy"),
    ("town_block", 1, "old-town"),
    ("corridor", 2, "arterial"),
    ("corridor", 3, "town-busy"),
    ("motorway_merge", 1, "motorway"),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("places")


@pytest.mark.parametrize(("kind", "seed", "demand"), DRIVES)
def test_nothing_runs_into_anything_and_traffic_flows(folder: Path, kind: str, seed: int, demand: str) -> None:
    drive = drive_drawn(place_roads(kind, seed, folder), demand, seed)
    assert drive.contacts == set()
    first = [vehicle.id for vehicle in drive.traffic.vehicles if vehicle.depart_s == 0.0]
    assert np.mean([name in drive.driven_m for name in first]) > 0.95
    assert np.median(list(drive.driven_m.values())) > 20.0


@pytest.mark.parametrize(("kind", "seed"), [("town_block", 1), ("corridor", 3)])
def test_a_drawing_takes_less_than_50_ms(folder: Path, kind: str, seed: int) -> None:
    roads, times = place_roads(kind, seed, folder), list[float]()
    for number in range(4):
        began = time.process_time()
        draw_traffic(roads, (), (), find_demand("town-busy"), random.Random(number))
        times.append(time.process_time() - began)
    assert min(times) < 0.05
