"""Riders out of passages between barns: their way is free, and the barn before it hides them from the road."""

import pytest
import shapely

from mdrive_sumo.generate.hard.family_parts import compute_pose, load_network
from mdrive_sumo.generate.hard.passage_pedestrian import DEEP_M, STREETS, WALL_M, PassageStreet, find_passages
from mdrive_sumo.roads import find_lane_path


@pytest.mark.parametrize("street", STREETS, ids=lambda street: street.own[0])
def test_riders_come_through_free_passages_past_a_wall(street: PassageStreet) -> None:
    roads = load_network(street.network)
    lanes = find_lane_path(roads, *street.own)
    houses = shapely.union_all(roads.building_shapes)
    passages = find_passages(roads, lanes)
    assert len(passages) >= 3
    for station in passages:
        begin, end = (compute_pose(roads, lanes, station, offset) for offset in (-DEEP_M, street.across_m))
        way = shapely.LineString([(begin.x, begin.y), (end.x, end.y)])
        assert houses.distance(way) > 0.3  # half the width of a rider
        before = compute_pose(roads, lanes, station - 1.5, -WALL_M - 0.2)
        assert houses.contains(shapely.Point(before.x, before.y))
