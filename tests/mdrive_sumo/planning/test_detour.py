"""Detours: clear of obstacles, on the road, drivable."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from testing.agents_driving import ego
from testing.bent_road import CAR, WIDTH, bent, box, road, told
from testing.sampling import examples

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.planning.detour import compute_box_extents, find_detour
from mdrive_sumo.planning.parameters import DETOUR
from mdrive_sumo.planning.path_overlap import compute_footprints, find_cells
from mdrive_sumo.planning.reference_path import PATH, SPACING_M, build_path
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.briefing_builder import build_briefing, compute_route_room


def strip(radius: float, oncoming: int) -> shapely.Geometry:
    """The road's surface."""
    lines = [bent(radius, aside=WIDTH * i) for i in range(oncoming + 1)]
    return shapely.union_all([shapely.buffer(shapely.LineString(xy), WIDTH / 2 + 0.02) for xy in lines])


class TestRoom:
    def test_room_reaches_the_edge_of_the_oncoming_lane(self) -> None:
        room = told(1e6).route_room
        assert room.shape == (121, 2)
        assert room[5:-5] == pytest.approx(np.tile((1.5 * WIDTH, WIDTH / 2), (111, 1)), abs=0.02)

    def test_room_is_capped(self) -> None:
        assert told(1e6, oncoming=4).route_room[60] == pytest.approx((10.0, WIDTH / 2), abs=0.02)

    def test_a_gap_between_carriageways_limits_room(self) -> None:
        two = road(1e6)
        apart = replace(two.lanes["l_0"], centre=Polyline(bent(1e6, aside=WIDTH + 0.5)[::-1]))
        roads = replace(two, lanes={**two.lanes, "l_0": apart})
        assert told_by(roads)[60, 0] == pytest.approx(WIDTH / 2, abs=0.02)

    def test_room_includes_a_junction_but_not_its_pavement(self) -> None:
        square = np.array([(50.0, -8.0), (70.0, -8.0), (70.0, 8.0), (50.0, 8.0)])
        corner = np.array([(50.0, -8.0), (70.0, -8.0), (70.0, -5.0), (50.0, -5.0)])
        roads = replace(road(1e6), junctions=(square,), pavements=(corner,))
        assert told_by(roads)[60] == pytest.approx((8.0, 5.0), abs=0.15)


def told_by(roads: RoadMap) -> Float:
    xy = bent(1e6)
    return compute_route_room(roads, xy, np.zeros(len(xy)))


@pytest.mark.slow
@settings(deadline=None, max_examples=examples(6, 30))
@given(
    radius=st.sampled_from([1e6, 60.0, -60.0, 25.0]),
    boxes=st.lists(
        st.tuples(
            st.integers(15, 45), st.floats(-2.5, 2.5), st.floats(0.3, 5.0), st.floats(0.3, 2.0), st.floats(-1, 1)
        ),
        min_size=1,
        max_size=3,
    ),
    speed=st.floats(0.0, 8.0),
    oncoming=st.integers(0, 2),
)
@example(radius=1e6, boxes=[(30, 0.0, 4.5, 1.8, 0.0)], speed=8.0, oncoming=1)
def test_a_detour_is_clear_on_the_road_and_drivable(
    radius: float, boxes: list[tuple[int, float, float, float, float]], speed: float, oncoming: int
) -> None:
    me = told(radius, oncoming)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    corners = np.array([box(me.route_xy, *one) for one in boxes])
    detour = find_detour(path, 3.0, speed, corners, me)
    assume(detour is not None)
    assert detour is not None
    cells = find_cells(detour.path, np.arange(3.0, detour.last_s, SPACING_M))
    mine = np.asarray(shapely.polygons(compute_footprints(detour.path, CAR.length, CAR.width, cells)))
    passed = shapely.polygons(corners[compute_box_extents(path, 3.0, corners)[:, 0] < detour.last_s - 4.0])
    assert shapely.distance(mine[:, None], passed).min() > 0.2
    beside = shapely.distance(shapely.union_all(mine), passed)
    assert (beside > 0.2).all()
    assert shapely.covers(strip(radius, oncoming), mine[np.linspace(0, len(mine) - 1, 40).astype(int)]).all()
    assert np.abs(detour.path.curvature[cells]).max() <= DETOUR.max_curvature
    # It begins and ends as the old path does, and its points are evenly spaced.
    old, new = shapely.LineString(path.xy), np.asarray(shapely.points(detour.path.xy))
    gone = np.asarray(shapely.distance(new, old))
    stations = np.arange(len(new)) * SPACING_M
    assert gone[(stations < detour.first_s) | (stations > detour.last_s)].max() < 0.01
    assert np.hypot(*np.diff(detour.path.xy, axis=0).T) == pytest.approx(SPACING_M, abs=0.01)
    assert detour.path.get_points(np.array((detour.path.goal_s,))) == pytest.approx(
        path.get_points(np.array((path.goal_s,))), abs=0.02 + float(gone[-1])
    )


def test_the_least_shift_is_taken() -> None:
    me = told(1e6)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    cone = box(me.route_xy, 35, -1.2, 0.4, 0.4)
    detour = find_detour(path, 0.0, 5.0, cone[None], me)
    assert detour is not None
    assert detour.path.xy[:, 1].max() == pytest.approx(-1.0 + 1.0 + 0.5, abs=0.1)  # cone's edge, half a car, clearance


def test_shifts_are_compared_after_further_boxes_enlarge_them() -> None:
    """The left one begins as the lesser one, but a thing beside the first makes it the greater one."""
    lanes = road(1e6).lanes
    roads = replace(
        road(1e6), lanes={**lanes, "r_1": replace(lanes["r_0"], id="r_1", centre=Polyline(bent(1e6, aside=-WIDTH)))}
    )
    me = build_briefing(ego("0", bent(1e6)), roads, CAR, 0, 100.0)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    boxes = np.array([box(me.route_xy, 35, -0.2, 0.8, 1.6), box(me.route_xy, 35, 1.8, 0.8, 0.8)])
    detour = find_detour(path, 0.0, 5.0, boxes, me)
    assert detour is not None
    assert detour.path.xy[:, 1].min() == pytest.approx(-2.5, abs=0.1)


def test_a_parked_car_is_passed_on_the_left_by_the_clearance() -> None:
    me = told(1e6)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    detour = find_detour(path, 0.0, 8.0, box(me.route_xy, 35, 0.0, 4.5, 1.8)[None], me)
    assert detour is not None
    assert detour.path.xy[:, 1].max() == pytest.approx(0.9 + 0.5 + 1.0, abs=0.02)


@pytest.mark.parametrize(
    ("boxes", "oncoming"),
    [
        ([(35, 0.0, 4.5, 1.8)], 0),  # no lane to go to
        ([(35, 0.0, 4.5, 1.8), (35, 3.0, 4.5, 1.8)], 1),  # the other lane is occupied too
        ([(8, 0.0, 4.5, 1.8)], 1),  # too near to turn out
        ([(35, 4.0, 4.5, 1.8)], 1),  # nothing is in the way
    ],
)
def test_there_is_no_detour(boxes: list[tuple[int, float, float, float]], oncoming: int) -> None:
    me = told(1e6, oncoming)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    assert find_detour(path, 3.0, 2.0, np.array([box(me.route_xy, *one) for one in boxes]), me) is None


def test_no_detour_without_knowledge_of_the_road() -> None:
    me = replace(told(1e6), route_room=np.zeros((0, 2)))
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    assert find_detour(path, 0.0, 5.0, box(me.route_xy, 35, 0.0, 4.5, 1.8)[None], me) is None


def test_no_detour_at_a_speed_too_high_for_the_transition() -> None:
    me = told(1e6)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    car = box(me.route_xy, 20, 0.0, 4.5, 1.8)[None]
    assert find_detour(path, 0.0, 3.0, car, me) is not None
    assert find_detour(path, 0.0, 10.0, car, me) is None


def test_what_stands_far_beyond_the_goal_is_no_failure() -> None:
    """The path runs out beyond the route, far on fast roads: a detour there has no point of the route within 10 m."""
    me = told(1e6, 1)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0, replace(PATH, run_out_m=60.0))
    behind = np.array([[(158.0, -0.5), (159.0, -0.5), (159.0, 0.5), (158.0, 0.5)]])
    detour = find_detour(path, 138.0, 0.0, behind, me)
    assert detour is None or detour.first_s > 131.0
