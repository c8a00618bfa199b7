"""Waypoints on lanes: which lane they mean, when the route changes lanes for them, and the dense route through them."""

from pathlib import Path

import numpy as np
import pytest
from testing.map_faults import lane, lanes_map
from testing.network_samples import built

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from real2sim.match.waypoint_matcher import build_dense_route, compute_start_pose, match_waypoints


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """Three lanes east at y = 0, 3.5 and 7, the middle one of 400 m, the others of 200 m; one lane west at y = 10.5."""
    folder: Path = tmp_path_factory.mktemp("roads")
    return built(
        folder,
        lanes_map(
            lane("r", [(0, 0), (200, 0)]),
            lane("m", [(0, 3.5), (200, 3.5)], ("on",)),
            lane("l", [(0, 7), (200, 7)]),
            lane("on", [(200, 3.5), (400, 3.5)]),
            lane("west", [(200, 10.5), (0, 10.5)]),
        ),
    )[1]


def match_y(roads: RoadMap, *xy: tuple[float, float]) -> tuple[list[float], tuple[int, ...]]:
    """y of the lanes of the kept waypoints, and which were dropped."""
    found = match_waypoints(roads, np.array(xy))
    return [float(roads.lanes[one.lane].centre.at(one.s)[1]) for one in found.projections], found.dropped


def test_waypoints_lie_on_the_lanes_that_lead_on(roads: RoadMap) -> None:
    """Also where a lane of the other direction is nearer."""
    assert match_y(roads, (10.0, 0.3), (100.0, -0.4))[0] == pytest.approx([0.0, 0.0])
    assert match_y(roads, (10.0, 7.0), (60.0, 9.5), (150.0, 7.2))[0] == pytest.approx([7.0, 7.0, 7.0])
    assert match_y(roads, (150.0, 10.5), (60.0, 9.5), (20.0, 10.2))[0] == pytest.approx([10.5, 10.5, 10.5])
    assert match_y(roads, (10.0, 3.5), (300.0, 3.5))[0] == pytest.approx([3.5, 3.5])


@pytest.mark.parametrize(("y", "changes"), [(2.5, False), (2.7, True), (3.5, True)])
def test_a_route_changes_over_and_back_for_a_waypoint_where_that_saves_more_than_it_costs(
    y: float, changes: bool, roads: RoadMap
) -> None:
    """Two changes cost 20 m, a metre off the centre line 12 m: at y = 2.5 m the lane saves 18 m, at 2.7 m 22.8."""
    found, dropped = match_y(roads, (4.0, 0.0), (16.0, y), (28.0, 0.0))
    assert found == pytest.approx([0.0, 3.5 if changes else 0.0, 0.0])
    assert dropped == ()


def test_a_change_is_made_as_soon_as_possible(roads: RoadMap) -> None:
    found = match_waypoints(roads, np.array([(10.0, 0.0), (150.0, 0.0), (350.0, 3.5)]))
    dense = build_dense_route(roads, found.legs)
    aside = dense.xy[np.abs(dense.xy[:, 1] - 1.75) < 1.7, 0]
    assert aside.min() > 149.0
    assert aside.max() < 156.5


def test_a_waypoint_without_a_lane_or_a_way_is_dropped_if_it_is_in_between(roads: RoadMap) -> None:
    assert match_y(roads, (10.0, 0.0), (50.0, 40.0), (100.0, 0.0)) == (pytest.approx([0.0, 0.0]), (1,))
    behind = match_y(roads, (100.0, 0.0), (40.0, -1.0), (150.0, 0.0))
    assert behind == (pytest.approx([0.0, 0.0]), (1,))
    assert match_y(roads, (10.0, -12.5), (20.0, 0.0), (100.0, 0.0)) == (pytest.approx([0.0, 0.0]), (0,))
    assert match_y(roads, (10.0, -11.5), (20.0, 0.0), (100.0, 0.0))[1] == ()


@pytest.mark.parametrize(
    ("xy", "sentence"),
    [
        ([(10.0, 0.0)], "expected at least 2 waypoints within 12 m of a lane, found 1"),
        ([(10.0, 0.0), (50.0, -20.0)], "expected at least 2 waypoints within 12 m of a lane, found 1"),
        ([(100.0, -2.0), (40.0, -2.0)], "expected a drivable way through the waypoints on network .*, found none"),
        ([(300.0, 3.5), (100.0, 3.5)], "expected a drivable way through the waypoints on network .*, found none"),
    ],
)
def test_waypoints_without_a_way_are_refused(xy: list[tuple[float, float]], sentence: str, roads: RoadMap) -> None:
    with pytest.raises(InputError, match=sentence):
        match_waypoints(roads, np.array(xy))


def dense(roads: RoadMap, *xy: tuple[float, float]) -> Float:
    return build_dense_route(roads, match_waypoints(roads, np.array(xy)).legs).xy


def test_a_dense_route_runs_from_the_first_to_the_last_waypoint_on_the_centre_lines(roads: RoadMap) -> None:
    route = dense(roads, (10.0, 0.4), (150.0, -0.3))
    assert route[0] == pytest.approx((10.0, 0.0), abs=0.01)
    assert route[-1] == pytest.approx((150.0, 0.0), abs=0.01)
    assert np.hypot(*np.diff(route, axis=0).T)[:-1] == pytest.approx(1.0, abs=0.02)
    found = match_waypoints(roads, np.array([(10.0, 0.4), (150.0, -0.3)]))
    assert compute_start_pose(roads, found.legs) == pytest.approx((10.0, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(("to", "room_m"), [(3.5, 5.0), (7.0, 10.0)])
def test_a_change_takes_five_metres_a_lane_and_has_no_corners(to: float, room_m: float, roads: RoadMap) -> None:
    route = dense(roads, (10.0, 0.0), (60.0, to))
    change = route[(route[:, 1] > 0.01) & (route[:, 1] < to - 0.01), 0]
    assert change.min() >= 10.0
    assert change.max() - change.min() == pytest.approx(room_m, abs=2.0)
    assert (np.diff(route[:, 1]) >= -1e-6).all()
    half = route[np.argmin(np.abs(route[:, 1] - to / 2)), 0]
    assert half == pytest.approx(10.0 + room_m / 2, abs=0.6)


def test_every_change_of_a_route_has_its_own_five_metres(tmp_path: Path) -> None:
    """One at the start, the other where the third lane begins."""
    roads = built(
        tmp_path,
        lanes_map(
            lane("r1", [(0, 0), (100, 0)], ("r2",)),
            lane("m1", [(0, 3.5), (100, 3.5)], ("m2",)),
            lane("r2", [(100, 0), (200, 0)]),
            lane("m2", [(100, 3.5), (200, 3.5)]),
            lane("l2", [(100, 7), (200, 7)]),
        ),
    )[1]
    route = dense(roads, (10.0, 0.0), (190.0, 7.0))
    for low, high in ((0.0, 3.5), (3.5, 7.0)):
        change = route[(route[:, 1] > low + 0.05) & (route[:, 1] < high - 0.05), 0]
        assert 2.0 <= change.max() - change.min() <= 5.0
