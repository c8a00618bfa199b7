"""Ends of a route beside its lanes, and what distances from lanes cost."""

import numpy as np
import pytest
from testing.map_faults import lane, lanes_map
from testing.network_samples import built

from mdrive_sumo.roads import RoadMap
from real2sim.match.lane_chain import BREAK_COST, compute_emission_cost, compute_transition_cost
from real2sim.match.route_repair import find_route_on_map


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """Two lanes east; the right one, "b0", is on the map between x = 60 and 140 only."""
    return built(
        tmp_path_factory.mktemp("border"),
        lanes_map(
            lane("a1", [(0, 3.5), (60, 3.5)], ("b1",)),
            lane("b1", [(60, 3.5), (140, 3.5)], ("c1",)),
            lane("c1", [(140, 3.5), (200, 3.5)]),
            lane("b0", [(60, 0), (140, 0)]),
        ),
    )[1]


def name(roads: RoadMap, x: float, y: float) -> str:
    return next(one.id for one in roads.driving if np.hypot(one.centre.xy[0, 0] - x, one.centre.xy[0, 1] - y) < 0.5)


def test_frames_beside_the_lanes_at_either_end_are_off_the_map(roads: RoadMap) -> None:
    before, cut, beside, after = (name(roads, *xy) for xy in ((0, 3.5), (60, 0), (60, 3.5), (140, 3.5)))
    outside = -3.5
    for route, lanes, offset, kept, frames in (
        ((cut, beside), (cut, cut, "", beside), (0.0, 0.1, np.nan, outside), (cut,), (3,)),
        ((cut, beside, after), (cut, beside, after), (0.0, outside, outside), (cut,), (1, 2)),
        ((before, beside, cut), (before, beside, "", cut), (outside, outside, np.nan, 0.0), (cut,), (0, 1)),
        ((before, beside, cut, beside, after), (before, cut, after), (outside, 0.0, outside), (cut,), (0, 2)),
        ((cut, beside, after), (cut, beside, after), (0.0, outside, -1.6), (cut, beside, after), ()),
        ((before, beside, cut), (before, beside, cut), (1.6, outside, 0.0), (before, beside, cut), ()),
        ((before, beside, after), (before, beside, after), (outside,) * 3, (before, beside, after), ()),
    ):
        found_route, found_frames = find_route_on_map(roads, route, lanes, np.array(offset))
        assert (found_route, tuple(sorted(found_frames))) == (kept, frames), route


def test_costs_of_places_are_those_of_a_normal_distribution() -> None:
    """Of lateral distance, sigma 0.8 m, and heading, sigma 15 degrees: its negative logarithm, 0 in the middle."""
    sigma_m, sigma_rad = 0.8, np.radians(15.0)
    places = np.array([0.0, 1.0, -1.0, 2.0, 3.0])
    assert compute_emission_cost(sigma_m * places, 0 * places) == pytest.approx(places**2 / 2)
    assert compute_emission_cost(0 * places, sigma_rad * places) == pytest.approx(places**2 / 2)
    assert compute_emission_cost(np.array([0.8]), np.array([sigma_rad])) == pytest.approx([1.0])
    assert compute_emission_cost(np.array([0.8]), np.array([np.nan])) == pytest.approx([0.5])


def test_a_step_costs_what_network_and_drive_differ_by_until_it_is_no_step() -> None:
    """A break beyond 10 m and a quarter of the way; a lane change costs as much as 2.3 to 2.8 sigma."""
    same = compute_transition_cost(20.0, 20.0, 0)
    assert same == 0.0
    assert compute_transition_cost(23.0, 20.0, 0) == compute_transition_cost(17.0, 20.0, 0) == pytest.approx(2.0)
    assert 2.3**2 / 2 < compute_transition_cost(20.0, 20.0, 1) < 2.9**2 / 2
    assert compute_transition_cost(20.0, 20.0, 2) == pytest.approx(2 * compute_transition_cost(20.0, 20.0, 1))
    for driven_m, most_m in ((0.0, 10.0), (20.0, 15.0), (100.0, 35.0)):
        assert compute_transition_cost(driven_m + most_m - 0.1, driven_m, 0) < BREAK_COST
        assert compute_transition_cost(driven_m + most_m + 0.1, driven_m, 0) == BREAK_COST
        assert compute_transition_cost(driven_m - most_m - 0.1, driven_m, 0) == BREAK_COST
    assert compute_transition_cost(124.9, 100.0, 5) < BREAK_COST
