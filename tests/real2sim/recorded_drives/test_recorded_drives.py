"""Synthetic recordings in the V2XPnP format: who crosses the CAVs' routes, and which part of a drive is kept."""

import math
import random
from types import MappingProxyType

import numpy as np
import pytest
import shapely
from testing.worlds import straight_ego, straight_road, straight_scenario

from mdrive_sumo.actors.kinematic_limits import LIMITS_BY_KIND
from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import TICKS_PER_SECOND, Actors, EgoState, End, Frame, Kind
from mdrive_sumo.episode import Ending, Recorder
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion, TimeTrigger
from mdrive_sumo.worlds.places import draw_place, write_place
from real2sim.recorded_drives.hidden_users import (
    APART_M,
    EARLY_S,
    STATION_M,
    RouteCrossing,
    compute_blind_times,
    draw_crossings,
    place_second_unit,
    time_crossing,
)
from real2sim.recorded_drives.record_drive import (
    APART_M as STARTS_APART_M,
)
from real2sim.recorded_drives.record_drive import (
    BEGIN_S,
    LONGEST_S,
    MEAN_DISTANCE_M,
    MIN_DISTANCE_M,
    SHORTEST_S,
    START_MPS,
    RecordedDrive,
    build_cavs,
    find_window,
)
from real2sim.recorded_drives.recording_site import PLACES, build_demand

Crossings = list[tuple[Ego, RouteCrossing]]


@pytest.fixture(scope="module", params=(0, 6, 9))
def roads(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """A drawn place with signals, one without, and a street without a junction."""
    _, choice, _ = PLACES[request.param]
    return load_road_map(
        write_place(draw_place(choice.kind, "test", **choice.parameters), tmp_path_factory.mktemp("p"))
    )


@pytest.fixture(scope="module")
def crossings(roads: RoadMap) -> Crossings:
    """Who crosses the routes of two CAVs, for seven seeds."""
    drawn: Crossings = []
    for seed in range(7):
        rng = random.Random(seed)
        drawn += draw_crossings(roads, build_cavs(roads, 2, rng), START_MPS, rng)
    return drawn


def test_places_of_all_settings_have_a_demand() -> None:
    settings = [setting for setting, _, _ in PLACES]
    assert len(settings) >= 12
    assert set(settings) == {"signalled", "unsignalled", "mid-block", "campus", "roundabout"}
    for _, _, demand in PLACES:
        assert build_demand(demand).most_people > 0


def compute_walk_s(actor: Actor, length_m: float) -> float:
    """Time that an actor needs from rest for a length of its way."""
    assert isinstance(actor.motion, PathMotion)
    speed, acceleration = actor.motion.speed, LIMITS_BY_KIND[Kind[actor.kind.upper()]].accel
    rising_m = speed * speed / acceleration / 2
    if length_m < rising_m:
        return math.sqrt(2 * length_m / acceleration)
    return speed / acceleration + (length_m - rising_m) / speed


def test_users_cross_the_route_when_a_blind_cav_is_there(crossings: Crossings) -> None:
    assert len(crossings) >= 6
    for ego, crossing in crossings:
        user = crossing.actors[-1]
        assert isinstance(user.motion, PathMotion)
        assert isinstance(user.trigger, TimeTrigger)
        assert STATION_M[0] <= crossing.station <= STATION_M[1]
        way, route = shapely.LineString(user.motion.points), shapely.LineString(ego.xy)
        assert way.intersects(route)
        met_m = way.line_locate_point(shapely.intersection(way, route).centroid)
        times = compute_blind_times(ego, START_MPS)
        met_s = float(np.interp(crossing.station, np.arange(len(times)), times))
        assert met_s - user.trigger.at_s == pytest.approx(crossing.moves_s, abs=0.01)
        assert user.trigger.at_s > BEGIN_S
        assert EARLY_S[0] - 0.3 < crossing.moves_s - compute_walk_s(user, met_m) < EARLY_S[1] + 0.3


def test_users_set_off_later_for_a_cav_that_starts_later_or_slower(crossings: Crossings) -> None:
    ego, crossing = crossings[0]

    def set_off_s(*start: float) -> float:
        trigger = time_crossing(ego, crossing, (start[0], start[1], start[2])).trigger
        assert isinstance(trigger, TimeTrigger)
        return trigger.at_s

    drawn = crossing.actors[-1].trigger
    assert isinstance(drawn, TimeTrigger)
    assert set_off_s(0.0, 0.0, START_MPS) == drawn.at_s
    assert set_off_s(1.0, 0.0, START_MPS) == pytest.approx(drawn.at_s + 1.0, abs=0.011)
    assert set_off_s(1.0, 2.0, 2.0) > set_off_s(1.0, 2.0, 4.0) > set_off_s(1.0, 4.0, 4.0)
    assert math.isfinite(set_off_s(1.0, 2.0, 0.0))


def test_most_users_come_out_from_behind_a_vehicle_and_a_unit_stands_beside_them(
    roads: RoadMap, crossings: Crossings
) -> None:
    screens = [crossing.actors[0] for _, crossing in crossings if len(crossing.actors) == 2]
    assert len(screens) > len(crossings) / 2
    for ego, crossing in crossings:
        user, unit = crossing.actors[-1], crossing.unit
        assert math.hypot(unit.x - user.start.x, unit.y - user.start.y) < 20.0
        other = place_second_unit(roads, ego, crossing)
        assert shapely.LineString(((unit.x, unit.y), (other.x, other.y))).intersects(shapely.LineString(ego.xy))


def test_two_users_on_one_route_are_apart(crossings: Crossings) -> None:
    stations: dict[int, list[float]] = {}
    for ego, crossing in crossings:
        stations.setdefault(id(ego), []).append(crossing.station)
    pairs = [pair for pair in stations.values() if len(pair) == 2]
    assert all(abs(one - other) > APART_M for one, other in pairs)
    assert pairs


def test_cavs_start_apart_on_one_axis(roads: RoadMap) -> None:
    for seed in range(3):
        one, other = build_cavs(roads, 2, random.Random(seed))
        assert math.hypot(one.start.x - other.start.x, one.start.y - other.start.y) > STARTS_APART_M
        assert abs(math.cos(one.start.yaw - other.start.yaw)) > 0.7


def drive(*legs: tuple[float, float], crossed_m: float = 0.0) -> RecordedDrive:
    """A CAV that goes so many seconds at a speed [m/s]."""
    recorder, tick, x = Recorder("straight", {}, {"0": (4.9, 2.06)}), 0, 0.0
    for seconds, speed in legs:
        for _ in range(round(seconds * TICKS_PER_SECOND)):
            frame = Frame(tick, {"0": EgoState(x, 0.0, 0.0, speed)}, Actors.empty(), MappingProxyType({}))
            recorder.add(frame, {"0": Control(0.0, 0.0, 0.0)}, {}, {})
            x += speed / TICKS_PER_SECOND
            tick += 1
    episode = recorder.finish([Ending("0", tick - 1, End.ARRIVED)])
    return RecordedDrive(straight_scenario(straight_ego("0")), straight_road(), episode, (crossed_m,))


def test_a_recording_ends_when_the_cav_has_driven_as_far_as_in_the_paper() -> None:
    begin, end = find_window(drive((20.0, 5.0))) or (0.0, 0.0)
    assert begin == BEGIN_S
    assert 0.0 <= end - begin - MEAN_DISTANCE_M / 5.0 < 0.5
    assert find_window(drive((20.0, 20.0))) == (BEGIN_S, BEGIN_S + SHORTEST_S)


def test_a_recording_goes_on_until_the_cav_has_passed_who_crosses() -> None:
    assert find_window(drive((20.0, 6.0), crossed_m=62.0)) == (BEGIN_S, BEGIN_S + 10.5)
    assert find_window(drive((20.0, 6.0), crossed_m=500.0)) == (BEGIN_S, BEGIN_S + LONGEST_S)


def test_a_drive_in_which_the_cav_hardly_drives_or_leaves_is_of_no_use() -> None:
    slow = (MIN_DISTANCE_M - 1.0) / LONGEST_S
    assert find_window(drive((30.0, slow))) is None
    assert find_window(drive((BEGIN_S + SHORTEST_S - 1.0, 8.0))) is None
