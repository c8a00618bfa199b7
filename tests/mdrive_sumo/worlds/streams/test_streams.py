"""Streams of SUMO's vehicles along edges and lanes, and standing queues."""

from itertools import pairwise

import pytest

from mdrive_sumo.roads import RoadMap, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor
from mdrive_sumo.worlds.placement.cavs import build_cav
from mdrive_sumo.worlds.placement.lane_chains import compute_lane_pose
from mdrive_sumo.worlds.placement.occupancy import locate_departure
from mdrive_sumo.worlds.streams.edge_streams import (
    KEEP_CLEAR_M,
    LEAST_HEADWAY_S,
    QUEUE_GAP_M,
    TrafficStream,
    build_standing_queue,
    build_traffic,
)
from mdrive_sumo.worlds.streams.lane_flows import MIXED, TrafficFlow, build_flows

EAST = tuple(f"east_{k}" for k in range(6))


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


@pytest.mark.parametrize("seed", ["a", "b", "c"])
def test_a_stream_keeps_clear_of_cavs_and_actors_and_enters_one_after_the_other(seed: str) -> None:
    roads = load("hard_corridor_market")
    lanes = find_lane_path(roads, "east_0_2", "east_5_2")
    cav = build_cav(roads, "0", lanes, (150.0, 300.0), 8.0)
    walker = build_actor("w", BODIES["adult"], compute_lane_pose(roads.lanes["east_2_3"], 40.0, -3.0))
    stream = TrafficStream(EAST, (2, 3))
    vehicles = build_traffic(roads, (stream,), 60, seed, (cav, walker))
    assert [one.id for one in vehicles] == [f"bg{k}" for k in range(len(vehicles))]
    present = [one for one in vehicles if one.depart_s == 0.0]
    assert 8 < len(present) <= 42 and len(vehicles) > len(present)
    boxes = [locate_departure(one, roads) for one in present]
    for box in boxes:
        assert min(box.distance(build_user_box(user)) for user in (cav, walker)) > KEEP_CLEAR_M
    assert all(one.distance(other) > 0.0 for k, one in enumerate(boxes) for other in boxes[:k])
    for lane in (2, 3):
        times = [one.depart_s for one in vehicles if one.depart_s > 0.0 and one.depart_lane == lane]
        assert all(after - before >= LEAST_HEADWAY_S - 0.02 for before, after in pairwise(times))
    assert build_traffic(roads, (stream,), 60, seed, (cav, walker)) == vehicles


def test_no_large_vehicles_drive_a_stream_without_them() -> None:
    roads = load("hard_corridor_market")
    stream = TrafficStream(EAST, (2, 3), large=False)
    assert max(one.length for one in build_traffic(roads, (stream,), 60, "a")) < 6.0


def test_a_queue_stands_with_its_gaps_and_ends_where_its_lane_begins() -> None:
    roads = load("hard_corridor_market")
    lane = roads.lanes["east_1_2"]
    queue = build_standing_queue(roads, lane.id, EAST[1:], ["car", "bus"] * 20, 1.0, "q")
    assert queue[0].depart_pos_m == round(lane.centre.length - 1.0, 2)
    assert 3 < len(queue) < 40
    for ahead, behind in pairwise(queue):
        assert ahead.depart_pos_m - ahead.length - behind.depart_pos_m == pytest.approx(QUEUE_GAP_M, abs=0.02)
        assert behind.depart_speed == 0.0
    assert queue[-1].depart_pos_m >= queue[-1].length + 1.0
