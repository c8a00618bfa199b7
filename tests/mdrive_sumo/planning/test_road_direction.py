"""Traffic follows the road, also where the own path leaves its lane."""

from dataclasses import replace

import numpy as np
import pytest
from testing.planning import briefing, own, things
from testing.road_speeds import WIDTH_M, centre_line

from mdrive_sumo.planning.moving_traffic import TRAFFIC
from mdrive_sumo.planning.parameters import MARGINS
from mdrive_sumo.planning.reference_path import build_path
from mdrive_sumo.planning.road_direction import align_with_road, build_road_direction
from mdrive_sumo.planning.traffic_prediction import TrafficView

RADIUS = 700.0
BEND = centre_line(0, RADIUS)[:401]
SIZE = (4.9, 2.0)


def view(route: np.ndarray, s: float = 0.0) -> TrafficView:
    return TrafficView(build_path(route, 1.42), build_road_direction(briefing(route)), s, SIZE)


def test_a_vehicle_in_the_next_lane_of_a_bend_stays_there() -> None:
    """Straight on it would cross the own lane 50 m later; a wrong heading of 1 degree changes nothing."""
    x, y = centre_line(1, RADIUS)[60]
    beside = things((x, y, 60.0 / (RADIUS - WIDTH_M) + 0.017, 30.0))
    here = view(BEND)
    cells = np.arange(0, len(here.path.xy), 4)
    times = np.arange(1, 80) * 0.125
    assert not here.find_blocked_cells(cells, beside, times, MARGINS.plan).any()
    aligned, bend = align_with_road(here.road, here.path, beside, np.zeros(1))
    assert aligned.yaw[0] == pytest.approx(60.0 / RADIUS, abs=2e-3)
    assert bend[0] == pytest.approx(1 / RADIUS, rel=0.05)


def test_a_lane_change_of_the_route_is_no_lane_change_of_the_others() -> None:
    """The own path goes over to the left lane after 100 m; the lanes go straight on."""
    x = np.arange(301.0)
    left = WIDTH_M * np.clip((x - 100.0) / 60.0, 0.0, 1.0)
    told = replace(briefing(np.column_stack((x, left))), route_yaw=np.zeros(301))
    here = TrafficView(build_path(told.route_xy, 1.42), build_road_direction(told), 0.0, SIZE)
    cells, times = np.arange(0, len(here.path.xy), 4), np.arange(1, 60) * 0.125
    beside = things((40.0, WIDTH_M, 0.0, 20.0))
    blocked = here.find_blocked_cells(cells, beside, times, MARGINS.plan)
    assert not blocked[:, :100].any()  # it stays in the left lane ...
    assert blocked[:, 150:].any()  # ... where the own path arrives


def test_a_gap_is_kept_behind_a_leader_and_none_before_a_follower() -> None:
    route = centre_line()[:401]
    here, times = view(route, 100.0), np.array([0.25, 0.5])
    cells = np.arange(0, 1600)
    lead = here.find_blocked_cells(cells, things((200.0, 0.0, 0.0, 20.0)), times, MARGINS.plan)
    first = float(np.flatnonzero(lead[0])[0]) * 0.25
    assert first == pytest.approx(200.0 + 0.25 * 20.0 - TRAFFIC.headway_s * 20.0 - 4.7 - 0.9, abs=1.0)
    assert not here.find_blocked_cells(cells, things((80.0, 0.0, 0.0, 30.0)), times, MARGINS.plan).any()
    assert [here.find_lead(own(x, y)) for x, y in ((200.0, 0.0), (50.0, 0.0), (200.0, WIDTH_M))] == [1, -1, 0]
