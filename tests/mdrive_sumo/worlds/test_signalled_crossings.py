"""Pedestrian crossings of networks and their green times."""

import numpy as np
import pytest

from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.worlds.signalled_crossings import find_signalled_crossings


@pytest.mark.parametrize(("network", "signalled"), [("city_crossing", 4), ("city_corridor", 3), ("school_crossing", 0)])
def test_crossings_are_those_of_the_network_and_know_their_lights(network: str, signalled: int) -> None:
    roads = load_road_map(find_network_folder(network))
    found = find_signalled_crossings(roads)
    for zebra, (line, _) in zip(found, roads.crossings, strict=True):
        np.testing.assert_array_equal(zebra.line, line[[0, -1]])
        for begin, end in zebra.green:
            assert 0.0 <= begin < end <= zebra.cycle_s
    assert sum(bool(zebra.green) for zebra in found) == signalled


def test_lights_let_people_cross_only_while_cars_from_that_road_wait() -> None:
    """Phases of the net: people cross the eastern arm while the north and the south have green, 22 to 31 s."""
    found = find_signalled_crossings(load_road_map(find_network_folder("city_crossing")))
    (east,) = (zebra for zebra in found if zebra.line[:, 0].min() > 10.0)
    (north,) = (zebra for zebra in found if zebra.line[:, 1].min() > 10.0)
    assert (east.green, east.cycle_s) == (((22.0, 31.0),), 44.0)
    assert north.green == ((0.0, 9.0),)
