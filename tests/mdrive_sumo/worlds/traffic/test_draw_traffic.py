"""Traffic that is drawn: the same bytes for the same seed, room for everything at the start, no crashes of its own."""

import random

import numpy as np
import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import boxes_overlap
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.worlds.traffic import DEMANDS, Traffic, draw_traffic, find_demand
from mdrive_sumo.worlds.traffic.occupancy import build_lane_box

NETWORKS = ("town_crossing", "city_corridor", "motorway", "old_town")


def roads_of(name: str) -> RoadMap:
    return load_road_map(find_network_folder(name))


def drawn(name: str, demand: str, seed: int) -> Traffic:
    return draw_traffic(roads_of(name), (), (), find_demand(demand), random.Random(seed))


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("demand", DEMANDS)
def test_the_same_seed_draws_the_same_traffic_and_another_one_other_traffic(name: str, demand: str) -> None:
    assert drawn(name, demand, 1) == drawn(name, demand, 1)
    assert drawn(name, demand, 1) != drawn(name, demand, 2)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", NETWORKS)
def test_no_vehicle_overlaps_another_at_the_start(name: str, seed: int) -> None:
    roads, traffic = roads_of(name), drawn(name, "town-busy", seed)
    present = [one for one in traffic.vehicles if one.depart_s == 0.0]
    assert len(present) > 3
    boxes = np.array(
        [
            build_lane_box(roads, f"{one.edges[0]}_{one.depart_lane}", one.depart_pos_m, (one.length, one.width))
            for one in present
        ]
    )
    overlap = boxes_overlap(boxes[:, None], boxes[None])
    assert not (overlap & ~np.eye(len(boxes), dtype=np.bool_)).any()


def test_an_unknown_demand_names_the_known_ones_and_the_one_that_was_meant() -> None:
    with pytest.raises(InputError, match=r"^demand: expected one of town-quiet, .*did you mean 'town-busy'\?$"):
        find_demand("town-bussy")
