"""A track on a lane that the map's border cuts off does not go over to the lane beside it."""

from pathlib import Path

import numpy as np
import pytest
from testing.map_faults import lane, lanes_map

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap, load_road_map
from real2sim.match import match_track
from real2sim.network import build_network

X: Float = np.arange(0.0, 200.0, 1.0)


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """Two lanes east; the right one, along y = 0, is on the map between x = 60 and 140 only."""
    folder: Path = tmp_path_factory.mktemp("border") / "net"
    lanes = [
        lane("a1", [(0, 3.5), (60, 3.5)], ("b1",)),
        lane("b1", [(60, 3.5), (140, 3.5)], ("c1",)),
        lane("c1", [(140, 3.5), (200, 3.5)]),
        lane("b0", [(60, 0), (140, 0)]),
    ]
    build_network(lanes_map(*lanes), [], folder, "border")
    return load_road_map(folder)


def match(roads: RoadMap, y: Float | float) -> tuple[list[str], Float]:
    """Edges and lanes of the route, and the x of the frames with a lane."""
    found = match_track(np.column_stack((X, np.broadcast_to(y, X.shape), np.zeros(len(X)))), roads)
    assert not found.break_frames
    return list(found.route), X[[bool(name) for name in found.lanes]]


def test_a_track_on_the_cut_off_lane_comes_onto_the_map_and_leaves_it_at_its_ends(roads: RoadMap) -> None:
    route, covered = match(roads, 0.0)
    assert len(route) == 1
    assert roads.lanes[route[0]].centre.xy[0].tolist() == [60.0, 0.0]
    assert covered[0] == pytest.approx(60.0, abs=4.5)
    assert covered[-1] == pytest.approx(140.0, abs=4.5)


def test_a_track_that_changes_to_the_lane_that_goes_on_is_followed(roads: RoadMap) -> None:
    route, covered = match(roads, np.interp(X, [110.0, 150.0], [0.0, 3.5]))
    assert roads.lanes[route[-1]].centre.xy[-1].tolist() == [200.0, 3.5]
    assert covered[-1] == X[-1]


def test_a_track_in_the_lane_that_goes_on_is_untouched(roads: RoadMap) -> None:
    route, covered = match(roads, 3.2)
    assert len(route) == 3
    assert len(covered) == len(X)
