"""Lane routes and features of networks."""

from collections.abc import Callable

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap, list_packaged_networks, load_road_map
from mdrive_sumo.worlds import lane_routes
from mdrive_sumo.worlds.lane_routes import find_lane_change_routes, find_lane_routes
from mdrive_sumo.worlds.network_features import Topology, extract_features

TOPOLOGIES = {
    "avenue": Topology.CORRIDOR,
    "country_road": Topology.TWO_LANE_CORRIDOR,
    "freeway": Topology.HIGHWAY,
    "lane_drop": Topology.HIGHWAY,
    "market_crossing": Topology.INTERSECTION,
    "roundabout": Topology.ROUNDABOUT,
    "side_street": Topology.T_JUNCTION,
}


@pytest.mark.parametrize("name", sorted(TOPOLOGIES))
def test_topologies_are_found_from_the_network(name: str) -> None:
    assert extract_features(load_road_map(list_packaged_networks()[name])).topology is TOPOLOGIES[name]


@pytest.mark.parametrize("name", ["large_roundabout", "market_crossing", "expressway"])
def test_ways_lead_from_rim_to_rim_on_connected_lanes(name: str) -> None:
    roads = load_road_map(list_packaged_networks()[name])
    for way in (*find_lane_routes(roads), *find_lane_change_routes(roads)):
        for i, (here, there) in enumerate(zip(way.lanes, way.lanes[1:], strict=False)):
            lane = roads.lanes[here]
            beside = there in (lane.left, lane.right)
            assert beside == (i == way.change_index)
            assert beside or there in lane.successors
        assert not roads.lanes[way.lanes[-1]].successors


@pytest.mark.parametrize("find", [find_lane_routes, find_lane_change_routes])
def test_a_network_with_too_many_routes_is_refused_before_the_search_runs_for_ever(
    find: Callable[[RoadMap], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lane_routes, "MOST_STEPS", 40)
    roads = load_road_map(list_packaged_networks()["hard_corridor_market"])
    find.cache_clear()  # type: ignore[attr-defined]
    with pytest.raises(
        InputError, match=r"network hard_corridor_market: expected a part of a town .* cut out a smaller"
    ):
        find(roads)
