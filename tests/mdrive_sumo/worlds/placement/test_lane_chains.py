"""Stations and poses along chains of lanes, CAVs on them, bodies, blind driving."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.roads import RoadMap, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import StandingMotion
from mdrive_sumo.worlds.placement.background_vehicles import DRIVING, FAST_DRIVING, build_background_vehicle
from mdrive_sumo.worlds.placement.blind_driving import blind_distance, blind_travel_time
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_actor
from mdrive_sumo.worlds.placement.cavs import NoRoomError, build_cav
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    build_route_line,
    compute_chain_length,
    compute_lane_begins,
    compute_pose,
    find_conflict_stations,
    find_station,
    select_lanes,
)


def load_chain() -> tuple[RoadMap, Lanes]:
    """A left turn over a crossing of the arterial road."""
    roads = load_road_map(find_network_folder("hard_arterial"))
    return roads, find_lane_path(roads, "east_0_3", "north_1_out_2")


ROADS, CHAIN = load_chain()
LENGTH = compute_chain_length(ROADS, CHAIN)


@settings(max_examples=40, deadline=None)
@given(st.floats(2.0, LENGTH - 2.0), st.floats(-1.0, 1.0))
def test_a_pose_is_where_its_station_and_offset_say(station: float, offset: float) -> None:
    here, aside = compute_pose(ROADS, CHAIN, station), compute_pose(ROADS, CHAIN, station, offset)
    assert math.hypot(aside.x - here.x, aside.y - here.y) == pytest.approx(abs(offset), abs=2e-3)
    left = (aside.x - here.x) * -math.sin(here.yaw) + (aside.y - here.y) * math.cos(here.yaw)
    assert left == pytest.approx(offset, abs=2e-3)
    assert find_station(ROADS, CHAIN, here.x, here.y) == pytest.approx(station, abs=0.05)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, LENGTH - 12.0), st.floats(0.1, 1.0))
def test_a_cav_drives_between_its_stations_on_the_lanes_that_it_names(start: float, share: float) -> None:
    goal = start + 11.0 + share * (LENGTH - start - 11.0)
    cav = build_cav(ROADS, "0", CHAIN, (start, goal), 7.004)
    assert cav.start_speed == 7.0
    assert (cav.start.x, cav.start.y, cav.start.yaw) == cav.route[0]
    assert find_station(ROADS, CHAIN, cav.start.x, cav.start.y) == pytest.approx(start, abs=0.05)
    assert goal - 1.05 <= find_station(ROADS, CHAIN, *cav.route[-1][:2]) <= goal
    assert cav.lanes == select_lanes(ROADS, CHAIN, start, goal)
    begins = dict(zip(CHAIN, compute_lane_begins(ROADS, CHAIN), strict=True))
    assert begins[cav.lanes[-1]] < goal and start < begins[cav.lanes[0]] + ROADS.lanes[cav.lanes[0]].centre.length


@pytest.mark.parametrize("drive", [(-1.0, 50.0), (20.0, 29.0), (20.0, LENGTH + 1.0)])
def test_a_cav_without_room_is_refused_in_a_sentence(drive: tuple[float, float]) -> None:
    with pytest.raises(NoRoomError, match=r"^0: expected at least 10 m of route within \d+ m of lanes, found -?\d+ to"):
        build_cav(ROADS, "0", CHAIN, drive, 5.0)


def test_lanes_meet_where_they_cross_or_never() -> None:
    oncoming = find_lane_path(ROADS, "west_1_2", "west_0_2")
    met = find_conflict_stations(build_route_line(ROADS, CHAIN), build_route_line(ROADS, oncoming))
    assert met is not None
    here, there = compute_pose(ROADS, CHAIN, met[0]), compute_pose(ROADS, oncoming, met[1])
    assert math.hypot(here.x - there.x, here.y - there.y) < 1.7
    assert compute_lane_begins(ROADS, CHAIN)[1] <= met[0] <= compute_lane_begins(ROADS, CHAIN)[-1] + 5.0
    apart = find_lane_path(ROADS, "east_0_1", "east_1_1")
    assert find_conflict_stations(build_route_line(ROADS, apart), build_route_line(ROADS, oncoming)) is None


# --- bodies -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(BODIES))
def test_every_body_makes_an_actor_that_stands_where_it_is_put(name: str) -> None:
    actor = build_actor("one", BODIES[name], Pose(x=1.0, y=2.0, yaw=0.5))
    assert (actor.model, actor.kind, actor.length, actor.width) == tuple(BODIES[name])
    assert isinstance(actor.motion, StandingMotion)


@pytest.mark.parametrize("model", sorted(DRIVING))
def test_background_vehicles_have_the_size_and_driving_of_their_model(model: str) -> None:
    length, width = BODY_SIZES[model]
    entering = build_background_vehicle(model, ("a", "b"), 1, depart_s=3.004)
    assert (entering.length, entering.width, entering.driving) == (length, width, DRIVING[model])
    assert (entering.depart_s, entering.depart_lane) == (3.0, 1)
    assert entering.depart_pos_m == round(length + 0.5, 2)  # its rear is on the lane
    assert build_background_vehicle("truck", ("a",), 0, FAST_DRIVING["truck"]).driving.max_speed == 24.0


def test_time_and_distance_of_blind_driving_are_inverse() -> None:
    for metres in (0.5, 5.0, 12.8, 40.0, 90.0):
        assert math.isclose(blind_distance(blind_travel_time(metres)), metres)
