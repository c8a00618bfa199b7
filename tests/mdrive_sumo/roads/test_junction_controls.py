"""Who gives way at the junctions of a network."""

import pytest

from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.roads.junction_controls import _list_links
from mdrive_sumo.roads.road_map import import_sumolib


@pytest.mark.parametrize("name", ["school_crossing", "hard_queue_crossing", "large_roundabout"])
def test_ways_have_the_index_that_sumolib_counts(name: str) -> None:
    net = import_sumolib().net.readNet(str(find_network_folder(name) / "map.net.xml.gz"), withInternal=True)
    links = [(node, way, index) for node in net.getNodes() for way, index in _list_links(net, node)]
    assert len(links) > 4
    assert all(node.getLinkIndex(way) == index for node, way, index in links)


def test_a_ring_is_entered_as_a_roundabout() -> None:
    roads = load_road_map(find_network_folder("roundabout"))
    entries = {via for via, kind in roads.junction_controls.items() if kind == "roundabout"}
    assert len(entries) == 4
    assert {
        roads.lanes[after].edge for via in entries for after in roads.lanes[via].successors
    } <= roads.roundabout_edges
