"""Ways around what stands on the path: clear of it, on the road, drivable; when they are taken, and when not."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from testing.agents_driving import ego

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState
from mdrive_sumo.core.geometry import Float, Polyline, boxes_corners
from mdrive_sumo.core.state import DT, Actors, EgoState, End, Kind, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.perception.static_object_tracker import StaticObjectTracker
from mdrive_sumo.planning.detour import compute_box_extents, find_detour
from mdrive_sumo.planning.obstacle_avoidance import ObstacleAvoidance
from mdrive_sumo.planning.parameters import DETOUR
from mdrive_sumo.planning.path_overlap import compute_footprints, find_cells
from mdrive_sumo.planning.reference_path import SPACING_M, build_path
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.roads import Lane, RoadMap, list_packaged_networks, load_road_map
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sensing.briefing_builder import build_briefing
from mdrive_sumo.sensing.route_room import compute_route_room
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts

CAR = to_vehicle_facts(MKZ_2017)
WIDTH = 3.5
STANDING_OWN = OwnState(10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def bent(radius: float, length: float = 120.0, aside: float = 0.0) -> Float:
    """A line that bends to the left (right, if negative) all along, `aside` metres to its left."""
    s = np.arange(0.0, length + 0.5, 1.0)
    yaw = s / radius
    return np.column_stack(
        (radius * np.sin(yaw) - aside * np.sin(yaw), radius * (1 - np.cos(yaw)) + aside * np.cos(yaw))
    )


def road(radius: float, oncoming: int = 1) -> RoadMap:
    """One lane, and so many of the other direction to its left."""

    def lane(name: str, xy: Float) -> Lane:
        return Lane(name, name, 0, WIDTH, 13.89, Polyline(xy), False, (), "", "", {})

    lanes = {"r_0": lane("r_0", bent(radius))}
    for i in range(oncoming):
        lanes[f"l_{i}"] = lane(f"l_{i}", bent(radius, aside=WIDTH * (i + 1))[::-1])
    return RoadMap("bent", Path("/nowhere"), lanes, (), (), (), (), (), "none")


@lru_cache
def told(radius: float, oncoming: int = 1) -> Briefing:
    """The briefing of a CAV that drives along the bent road."""
    return build_briefing(ego("0", bent(radius)), road(radius, oncoming), CAR, 0, 100.0)


def box(path_xy: Float, at: int, aside: float, length: float, width: float, turned: float = 0.0) -> Float:
    """Corners (4, 2) of a box beside the chain's point."""
    (x, y), yaw = path_xy[at], Polyline(path_xy).yaws[at]
    x, y = x - math.sin(yaw) * aside, y + math.cos(yaw) * aside
    return boxes_corners(*(np.array(v) for v in (x, y, yaw + turned, length, width)))


def strip(radius: float, oncoming: int) -> shapely.Geometry:
    """The road's surface."""
    lines = [bent(radius, aside=WIDTH * i) for i in range(oncoming + 1)]
    return shapely.union_all([shapely.buffer(shapely.LineString(xy), WIDTH / 2 + 0.02) for xy in lines])


class TestRoom:
    def test_it_goes_to_the_edge_of_the_oncoming_lane(self) -> None:
        room = told(1e6).route_room
        assert room.shape == (121, 2)
        assert room[5:-5] == pytest.approx(np.tile((1.5 * WIDTH, WIDTH / 2), (111, 1)), abs=0.02)

    def test_it_is_capped(self) -> None:
        assert told(1e6, oncoming=4).route_room[60] == pytest.approx((10.0, WIDTH / 2), abs=0.02)

    def test_a_gap_between_carriageways_ends_it(self) -> None:
        two = road(1e6)
        apart = replace(two.lanes["l_0"], centre=Polyline(bent(1e6, aside=WIDTH + 0.5)[::-1]))
        roads = replace(two, lanes={**two.lanes, "l_0": apart})
        assert told_by(roads)[60, 0] == pytest.approx(WIDTH / 2, abs=0.02)

    def test_a_junction_belongs_to_it_and_its_pavement_does_not(self) -> None:
        square = np.array([(50.0, -8.0), (70.0, -8.0), (70.0, 8.0), (50.0, 8.0)])
        corner = np.array([(50.0, -8.0), (70.0, -8.0), (70.0, -5.0), (50.0, -5.0)])
        roads = replace(road(1e6), junctions=(square,), pavements=(corner,))
        assert told_by(roads)[60] == pytest.approx((8.0, 5.0), abs=0.15)


def told_by(roads: RoadMap) -> Float:
    xy = bent(1e6)
    return compute_route_room(roads, xy, np.zeros(len(xy)))


@settings(deadline=None, max_examples=30)
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
    mine = shapely.polygons(compute_footprints(detour.path, CAR.length, CAR.width, cells))
    passed = shapely.polygons(corners[compute_box_extents(path, 3.0, corners)[:, 0] < detour.last_s - 4.0])
    assert shapely.distance(mine[:, None], passed).min() > 0.2
    beside = shapely.distance(shapely.union_all(mine), passed)
    assert (beside > 0.2).all()
    assert shapely.covers(strip(radius, oncoming), mine[np.linspace(0, len(mine) - 1, 40).astype(int)]).all()
    assert np.abs(detour.path.curvature[cells]).max() <= DETOUR.max_curvature
    # It begins and ends as the old path does, and its points are evenly spaced.
    old, new = shapely.LineString(path.xy), shapely.points(detour.path.xy)
    gone = shapely.distance(new, old)
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


def test_a_shift_that_brings_more_into_the_way_is_compared_as_it_ends() -> None:
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


def test_who_moved_once_is_remembered() -> None:
    standing, seen = StaticObjectTracker(), things((20.0, 0.0, 0.0), (40.0, 0.0, 0.0))
    for tick, x in enumerate((20.0, 20.0, 25.0, 25.0)):
        seen = things((x, 0.0, 0.0), (40.0, 0.0, 0.0))
        standing.update(tick, seen)
    assert standing.find_never_moved(seen).tolist() == [False, True]


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


def test_without_knowledge_of_the_road_nobody_leaves_the_path() -> None:
    me = replace(told(1e6), route_room=np.zeros((0, 2)))
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    assert find_detour(path, 0.0, 5.0, box(me.route_xy, 35, 0.0, 4.5, 1.8)[None], me) is None


def test_who_is_too_fast_for_the_ramp_slows_down_first() -> None:
    me = told(1e6)
    path = build_path(me.route_xy, CAR.rear_to_centre, 0.0)
    car = box(me.route_xy, 20, 0.0, 4.5, 1.8)[None]
    assert find_detour(path, 0.0, 3.0, car, me) is not None
    assert find_detour(path, 0.0, 10.0, car, me) is None


def things(*rows: tuple[float, float, float], kind: Kind = Kind.STATIC) -> Objects:
    """Boxes of a car's size at x, y [m] that look east, with a speed [m/s]."""
    x, y, speed = np.array(rows).reshape(-1, 3).T
    size = np.ones(len(x))
    names = tuple(f"b{i}" for i in range(len(x)))
    return Objects(names, np.full(len(x), kind, dtype=np.uint8), x, y, 0 * x, speed, 4.5 * size, 1.8 * size)


class TestStanding:
    def test_the_mean_of_noisy_looks_is_better_than_one(self) -> None:
        rng, standing = np.random.default_rng(0), StaticObjectTracker()
        for tick in range(0, 80, 4):
            noisy = things((20.0 + rng.normal(0, 0.2), rng.normal(0, 0.2), rng.normal(0, 0.5)))
            standing.update(tick, noisy)
        best = standing.replace_by_means(noisy, np.array([True]))
        assert standing.compute_standstill_durations(noisy) == pytest.approx([3.8])
        assert math.hypot(best.x[0] - 20.0, best.y[0]) < 0.12
        assert best.speed[0] == 0.0
        assert best.kind[0] == Kind.STATIC

    def test_who_creeps_does_not_stand(self) -> None:
        standing = StaticObjectTracker()
        for tick in range(0, 240, 4):
            creeping = things((20.0 + 0.3 * tick * DT, 0.0, 0.3))
            standing.update(tick, creeping)
        assert standing.compute_standstill_durations(creeping)[0] < 8.0

    def test_what_is_missed_is_recalled_for_a_second(self) -> None:
        standing, nothing = StaticObjectTracker(), things()
        for tick in range(0, 44, 4):
            standing.update(tick, things((20.0, 0.0, 0.0)))
        assert standing.add_missed_objects(50, nothing, 1.0).ids == ("b0",)
        assert standing.add_missed_objects(50, nothing, 3.0).ids == ()
        assert standing.add_missed_objects(70, nothing, 1.0).ids == ()


class Driver:
    """A CAV that stands at x = 10 and looks around."""

    def __init__(self, oncoming: int = 1) -> None:
        self.me = told(1e6, oncoming)
        self.planner = SpaceTimePlanner(self.me, 0.0, 8.0)
        self.passing = ObstacleAvoidance(self.me)
        self.path = self.planner.path

    def looks(self, seconds: float, objects: Objects, halts: tuple[float, ...] = ()) -> tuple[bool, list[float]]:
        """Whether the path is another one after so long, and where to wait."""
        own, held = STANDING_OWN, []
        for tick in range(0, round(seconds / DT) + 1, 4):
            self.planner.track_ego(tick, own)
            _, holds = self.passing.update(Observation(tick, own, objects), objects, self.planner, list(halts))
            held = [barrier.s for barrier in holds]
        return self.planner.path is not self.path, held


class TestPassing:
    def test_a_thing_is_passed_once_it_is_sure_to_be_there(self) -> None:
        assert not Driver().looks(0.6, things((35.0, 0.0, 0.0)))[0]
        assert Driver().looks(1.4, things((35.0, 0.0, 0.0)))[0]

    def test_a_car_is_passed_when_it_has_stood_for_long(self) -> None:
        car = things((35.0, 0.0, 0.0), kind=Kind.VEHICLE)
        diverted, held = Driver().looks(9.0, car)
        assert not diverted
        assert held == [pytest.approx(35.0 - 2.25 - 2.45 - 10.0, abs=0.1)]
        assert Driver().looks(10.4, car)[0]

    @pytest.mark.parametrize("kind", [Kind.PEDESTRIAN, Kind.CYCLIST])
    def test_people_are_waited_for(self, kind: Kind) -> None:
        assert not Driver().looks(15.0, things((35.0, 0.0, 0.0), kind=kind))[0]

    def test_who_stands_before_a_red_light_is_not_parked(self) -> None:
        car = things((35.0, 0.0, 0.0), kind=Kind.VEHICLE)
        assert not Driver().looks(15.0, car, halts=(38.0,))[0]
        assert Driver().looks(15.0, things((35.0, 0.0, 0.0)), halts=(38.0,))[0]

    def test_who_waits_for_somebody_is_not_parked(self) -> None:
        driver, own = Driver(), STANDING_OWN
        for tick in range(0, 300, 4):
            both = things((35.0, 0.0, 0.0), (30.0 + tick % 12, 5.0, 3.0), kind=Kind.VEHICLE)
            driver.planner.track_ego(tick, own)
            driver.passing.update(Observation(tick, own, both), both, driver.planner, [])
        assert driver.planner.path is driver.path

    def test_oncoming_traffic_is_waited_for(self) -> None:
        driver, own = Driver(), STANDING_OWN
        diverted_at = None
        for tick in range(0, 400, 4):
            x = 90.0 - 8.0 * tick * DT
            both = things((35.0, 0.0, 0.0), (x, WIDTH, 8.0))
            both = replace(
                both, kind=np.array([Kind.STATIC, Kind.VEHICLE], dtype=np.uint8), yaw=np.array([0.0, math.pi])
            )
            driver.planner.track_ego(tick, own)
            driver.passing.update(Observation(tick, own, both), both, driver.planner, [])
            if diverted_at is None and driver.planner.path is not driver.path:
                diverted_at = x
        assert diverted_at is not None
        assert diverted_at < 20.0

    def test_other_cars_that_stand_are_no_obstacles_to_go_around(self) -> None:
        driver = Driver()
        both = things((35.0, 0.0, 0.0), (35.0, WIDTH, 0.0), kind=Kind.VEHICLE)
        assert not driver.looks(15.0, both)[0]

    def test_a_blocked_road_is_waited_at(self) -> None:
        diverted, held = Driver(oncoming=0).looks(3.0, things((35.0, 0.0, 0.0)))
        assert not diverted
        assert held == [pytest.approx(35.0 - 2.25 - 2.45 - 10.0, abs=0.1)]


@dataclass(frozen=True)
class Thing:
    """A box that goes straight on at its speed [m/s], or stands; pose [m, m, rad] and size [m]."""

    kind: Kind
    x: float
    y: float
    yaw: float
    speed: float = 0.0
    length: float = 4.5
    width: float = 1.8


class ThingWorld:
    """A World of things; every light shows g."""

    def __init__(self, things: tuple[Thing, ...]) -> None:
        self._things, self._tick = things, -1

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        self._tick += 1
        if not self._things:
            return WorldState(Actors.empty(), {})
        columns = [(t.x, t.y, t.yaw, t.speed, t.length, t.width) for t in self._things]
        x, y, yaw, speed, length, width = np.array(columns).T
        gone = speed * self._tick * DT
        names = tuple(f"b{i}" for i in range(len(columns)))
        kinds = np.array([t.kind for t in self._things], dtype=np.uint8)
        actors = Actors(names, kinds, x + gone * np.cos(yaw), y + gone * np.sin(yaw), yaw, speed, length, width)
        return WorldState(actors, {})


def lane_of(network: str, lane: str) -> tuple[RoadMap, Lane]:
    roads = load_road_map(list_packaged_networks()[network])
    return roads, roads.lanes[lane]


def beside(lane: Lane, s: float, aside: float, kind: Kind, size: tuple[float, float] = (4.5, 1.8)) -> Thing:
    """Something that stands in or beside a lane."""
    (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
    return Thing(kind, x - math.sin(yaw) * aside, y + math.cos(yaw) * aside, yaw, 0.0, *size)


def driven(network: str, lane: str, things: tuple[Thing, ...], agent: str = "single", seed: int = 0) -> EpisodeRecord:
    """One CAV along a lane of a packaged network."""
    roads, way = lane_of(network, lane)
    one = ego("0", way.centre.resample(1.0).xy[5:-15]).model_copy(update={"lanes": (lane,)})
    scenario = Scenario(id="detour", bucket="Test", category="test", network=network, egos=(one,))
    return run_episode(
        EpisodeConfig(scenario, roads, seed=seed), ThingWorld(things), {"0": LocalDriver(AGENTS[agent]({}))}
    )


def off_road_m(episode: EpisodeRecord, roads: RoadMap) -> float:
    """How far [m] the CAV's corners come off the lanes, at most."""
    lines = [shapely.LineString(lane.centre.xy) for lane in roads.driving]
    surface = shapely.union_all([shapely.buffer(line, WIDTH / 2) for line in lines])
    size = np.array(CAR.length), np.array(CAR.width)
    present = episode.valid[:, 0]
    boxes = boxes_corners(episode.x[present, 0], episode.y[present, 0], episode.yaw[present, 0], *size)
    return float(shapely.distance(shapely.points(boxes), surface).max())


STREETS = [("town_crossing", "east_out_1"), ("old_town", "west_in_1")]


class TestOnTheRoad:
    @pytest.mark.parametrize(("network", "name"), STREETS)
    @pytest.mark.parametrize("kind", [Kind.STATIC, Kind.VEHICLE])
    def test_what_stands_is_passed(self, network: str, name: str, kind: Kind) -> None:
        roads, lane = lane_of(network, name)
        thing = beside(lane, 45.0, 0.2, kind, (4.5, 1.8) if kind == Kind.VEHICLE else (2.0, 2.0))
        episode = driven(network, name, (thing,))
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()
        assert off_road_m(episode, roads) < 0.05

    def test_nobody_swerves_on_a_free_road(self) -> None:
        _, lane = lane_of(*STREETS[0])
        episode = driven(*STREETS[0], (beside(lane, 45.0, -3.6, Kind.STATIC, (1.0, 1.0)),))
        assert episode.find_ending("0").end is End.ARRIVED
        assert np.abs(episode.y[episode.valid[:, 0], 0] + WIDTH / 2).max() < 0.1

    def test_a_wall_across_the_road_is_stopped_at(self) -> None:
        _, lane = lane_of(*STREETS[0])
        wall = beside(lane, 45.0, 1.75, Kind.STATIC, (1.0, 12.0))
        episode = driven(*STREETS[0], (wall,))
        assert episode.find_ending("0").end is End.BLOCKED
        assert episode.contacts == ()
        assert episode.x[:, 0].max() > wall.x - 16.0

    @pytest.mark.parametrize("gap_m", [30.0, 60.0])
    def test_oncoming_traffic_is_let_through(self, gap_m: float) -> None:
        _, lane = lane_of(*STREETS[0])
        thing = beside(lane, 45.0, 0.0, Kind.STATIC, (2.0, 2.0))
        cars = tuple(Thing(Kind.VEHICLE, 110.0 + gap_m * i, WIDTH / 2, math.pi, 8.0, 4.5, 1.8) for i in range(5))
        episode = driven(*STREETS[0], (thing, *cars))
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()

    def test_one_thing_after_another_is_passed(self) -> None:
        roads, lane = lane_of(*STREETS[0])
        things = (
            beside(lane, 25.0, 0.0, Kind.STATIC, (1.0, 1.0)),
            beside(lane, 38.0, -0.8, Kind.STATIC, (1.0, 1.0)),
            beside(lane, 66.0, 0.3, Kind.STATIC, (1.0, 1.0)),
        )
        episode = driven(*STREETS[0], things)
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()
        assert off_road_m(episode, roads) < 0.05

    @pytest.mark.slow
    @pytest.mark.parametrize("agent", ["single", "sharing", "sharing+negotiation", "colmdriver-rule"])
    @pytest.mark.parametrize("seed", range(3))
    def test_with_other_errors_of_the_detector(self, agent: str, seed: int) -> None:
        for network, name in STREETS:
            _, lane = lane_of(network, name)
            for kind in (Kind.STATIC, Kind.VEHICLE):
                episode = driven(network, name, (beside(lane, 45.0, 0.0, kind),), agent, seed)
                assert episode.find_ending("0").end is End.ARRIVED
                assert episode.contacts == ()
