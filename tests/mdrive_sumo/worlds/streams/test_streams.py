"""Flows of SUMO's vehicles along lanes."""

from itertools import pairwise

import pytest

from mdrive_sumo.roads import RoadMap, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.worlds.streams.lane_flows import MIXED, TrafficFlow, build_flows


def load(name: str) -> RoadMap:
    return load_road_map(find_network_folder(name))


def test_a_flow_has_its_mean_and_keeps_its_headway() -> None:
    roads = load("hard_motorway_merge")
    lanes = find_lane_path(roads, "main_0", "after_0")
    flow = TrafficFlow(lanes, 900.0, MIXED, is_entering=True)
    vehicles = build_flows(roads, (flow,), "seed", (), duration_s=3600.0)
    assert len(vehicles) == pytest.approx(900.0, rel=0.15)
    times = [one.depart_s for one in vehicles]
    assert all(after - before > 1.6 for before, after in pairwise(times))
    assert {one.driving.max_speed for one in vehicles} == {None, 24.0, 30.0}
