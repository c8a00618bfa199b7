"""What a seed draws: seed 0 changes nothing, every other seed gives another world within the stated bounds."""

import math

import pytest

from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import BackgroundVehicle, Schedule
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import CommonStartShift, Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, DistanceTrigger, PathMotion, ReplayMotion, StandingMotion
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.scenario.start_variation import FRONT_M
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scenario.variation import BOUNDS, load_varied_scenario, trim_rows, vary_scenario
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks

SAMPLE = ("i12_ins_sl_old_town", "i39_hw_merge_loop", "crosswalk_09", "pre-crash_01", "overtaking_03")
SAMPLE_LOGGED = "corridor_000"
SEEDS = (1, 2, 3, 4, 5)


@pytest.fixture(scope="module")
def whole() -> Suite:
    return load_suite("mdrive@0")


@pytest.fixture(scope="module")
def sample(whole: Suite) -> tuple[Scenario, ...]:
    """Some scenarios of every bucket."""
    return tuple(one for one in whole if one.id in (*SAMPLE, SAMPLE_LOGGED))


def check_varied(suite: Suite, written: Scenario, seed: int) -> Scenario:
    """Return the scenario that a seed draws, after all checks."""
    varied, roads = load_varied_scenario(suite, written, seed)
    check_scenario(varied, roads)
    assert not [problem for problem in find_spawn_overlaps(varied, roads) if "CAV" in problem], (written.id, seed)
    assert Scenario.model_validate(varied.model_dump()).model_dump() == varied.model_dump()
    assert compute_time_limit_ticks(varied) == compute_time_limit_ticks(written)
    assert varied.as_written is written
    for ego, was in zip(varied.egos, written.egos, strict=True):
        check_start(ego, was, roads, written)
    check_actors(varied, written)
    check_vehicles(varied, written)
    return varied


def check_start(ego: Ego, was: Ego, roads: RoadMap, written: Scenario) -> None:
    """A start is on the same lane at the same lateral position, before the line it was before; the goal stays."""
    centre = roads.lanes[was.lanes[0]].centre
    (now_s, now_d), (then_s, then_d) = (centre.project(one.start.x, one.start.y) for one in (ego, was))
    furthest = BOUNDS.start.shift_m + was.start_speed * BOUNDS.log_trim_s * (not is_unlogged(written))
    assert -BOUNDS.start.shift_m - 0.1 <= now_s - then_s <= furthest + 0.3, (written.id, was.id)
    assert abs(now_d - then_d) < 0.3 or then_s == 0.0  # written to start just before that lane
    assert (ego.route[-1], ego.lanes, ego.id) == (was.route[-1], was.lanes, was.id)
    lines = [sign.line_pos_m for sign in roads.stop_signs or () if sign.lane == was.lanes[0]]
    for line in (*lines, centre.length):
        assert now_s + FRONT_M <= line or now_s <= then_s + 0.01 or then_s + FRONT_M > line
    slowest, fastest = (was.start_speed * (1 + sign * BOUNDS.start.speed_share) for sign in (-1, 1))
    assert slowest - 0.001 <= ego.start_speed <= (fastest if was.start_speed else BOUNDS.start.speed) + 0.001


def is_unlogged(scenario: Scenario) -> bool:
    return not scenario.background.vehicles


def check_actors(varied: Scenario, written: Scenario) -> None:
    """Props and parked cars stay as they are; places of all others too."""
    for now, then in zip(varied.actors, written.actors, strict=True):
        if isinstance(then.motion, StandingMotion):
            assert now == then
        assert now.start == then.start
        if isinstance(then.motion, PathMotion) and isinstance(now.motion, PathMotion):
            assert now.motion.points == then.motion.points
            assert now.motion.speed == pytest.approx(then.motion.speed, rel=BOUNDS.actor_speed_share + 0.001)
        if isinstance(then.trigger, DistanceTrigger) and isinstance(now.trigger, DistanceTrigger):
            assert now.trigger.distance_m == pytest.approx(then.trigger.distance_m, rel=BOUNDS.trigger_share + 0.001)
        if isinstance(then.motion, ReplayMotion) and isinstance(now.motion, ReplayMotion):
            trim = then.motion.poses[-1][0] - now.motion.poses[-1][0]
            assert -0.001 <= trim <= BOUNDS.log_trim_s + 0.001


def check_vehicles(varied: Scenario, written: Scenario) -> None:
    """Logged traffic keeps its order: all schedules are trimmed by one and the same time."""
    trims: set[float] = set()
    for now, then in zip(varied.background.vehicles, written.background.vehicles, strict=True):
        assert now.driving.tau_s == pytest.approx(then.driving.tau_s, rel=BOUNDS.driver_share + 0.001)
        assert abs(now.driving.sigma - then.driving.sigma) <= BOUNDS.imperfection + 0.001
        if now.schedule is not None and then.schedule is not None:
            trims.add(round(then.schedule.progress[-1][0] - now.schedule.progress[-1][0], 3))
            assert now.schedule.progress[-1][1] == then.schedule.progress[-1][1]
            assert now.depart_s == now.schedule.progress[0][0]
    assert len(trims) <= 1
    assert all(0.0 <= trim <= BOUNDS.log_trim_s for trim in trims)


@pytest.mark.slow
def test_seed_0_is_the_scenario_as_written(whole: Suite, sample: tuple[Scenario, ...]) -> None:
    for written in sample:
        again, roads = load_varied_scenario(whole, written, 0)
        assert again is written
        assert vary_scenario(vary_scenario(written, roads, 3), roads, 0) is written


@pytest.mark.slow
def test_other_seeds_are_other_worlds_within_the_bounds(whole: Suite, sample: tuple[Scenario, ...]) -> None:
    for written in sample:
        worlds = [check_varied(whole, written, seed).model_dump_json() for seed in SEEDS]
        assert len({*worlds, written.model_dump_json()}) == len(SEEDS) + 1


@pytest.mark.full
def test_every_scenario_has_six_worlds_that_pass_the_checks(whole: Suite) -> None:
    for written in whole:
        worlds = [written, *(check_varied(whole, written, seed) for seed in SEEDS)]
        assert len({one.model_dump_json() for one in worlds}) == len(SEEDS) + 1, written.id


def test_a_seed_gives_one_world_whatever_was_drawn_before(whole: Suite, sample: tuple[Scenario, ...]) -> None:
    """And in every process: the values are those of the first run of this test."""
    alone = {one.id: load_varied_scenario(whole, one, 4)[0] for one in sample}
    for one in reversed(sample):
        _, roads = load_varied_scenario(whole, one, 5)
        assert vary_scenario(vary_scenario(one, roads, 5), roads, 4).model_dump() == alone[one.id].model_dump()
    start = alone["i12_ins_sl_old_town"].egos[0]
    assert (start.start.x, start.start.y, start.start_speed) == (-0.999, 25.107, 0.118)


def test_the_order_of_road_users_does_not_matter(whole: Suite) -> None:
    written = whole.select("crosswalk_09")[0]
    _, roads = load_varied_scenario(whole, written, 0)
    turned = written.model_copy(update={"actors": written.actors[::-1]})
    assert vary_scenario(turned, roads, 1).actors[::-1] == vary_scenario(written, roads, 1).actors


def test_a_start_that_is_hemmed_in_stays(whole: Suite) -> None:
    """Props 0.5 m before and behind a CAV leave it where it is written; its speed varies all the same."""
    written = whole.select("i12_ins_sl_old_town")[0]
    _, roads = load_varied_scenario(whole, written, 0)
    prop = whole.select("blocked-lane_01")[0].actors[0].model_copy(update={"length": 1.0, "width": 1.0})
    pose, ahead = written.egos[0].start, FRONT_M + 1.0
    placed = tuple(
        prop.model_copy(
            update={
                "id": f"block{sign}",
                "start": pose.model_copy(update=offset(pose.yaw, sign * ahead, pose.x, pose.y)),
            }
        )
        for sign in (-1, 1)
    )
    for seed in SEEDS:
        varied = vary_scenario(written.model_copy(update={"actors": placed}), roads, seed)
        assert varied.egos[0].start == pose
        assert varied.egos[0].start_speed > 0.0


def offset(yaw: float, ahead: float, x: float, y: float) -> dict[str, float]:
    return {"x": x + ahead * math.cos(yaw), "y": y + ahead * math.sin(yaw)}


def test_a_route_keeps_its_length_but_for_the_shift(whole: Suite) -> None:
    written = whole.select("i12_ins_sl_old_town")[0]
    varied, roads = load_varied_scenario(whole, written, 1)
    for ego, was in zip(varied.egos, written.egos, strict=True):
        centre = roads.lanes[was.lanes[0]].centre
        shift = centre.project(ego.start.x, ego.start.y)[0] - centre.project(was.start.x, was.start.y)[0]
        assert Polyline(ego.xy).length == pytest.approx(Polyline(was.xy).length - shift, abs=0.02)


def test_a_log_is_cut_at_the_new_beginning() -> None:
    """By hand: halfway between the rows of 0 s and 0.4 s; an angle turns the shorter way."""
    rows = ((0.0, 2.0, 0.0, 3.1), (0.4, 4.0, 1.0, -3.1), (0.9, 5.0, 1.0, -3.0))
    cut = trim_rows(rows, 0.2)
    assert [row[0] for row in cut] == pytest.approx([0.0, 0.2, 0.7])
    assert cut[0][1:3] == pytest.approx((3.0, 0.5))
    assert abs(cut[0][3]) == pytest.approx(math.pi, abs=0.01)
    assert trim_rows(rows, 0.4) == ((0.0, *rows[1][1:]), (0.5, *rows[2][1:]))
    assert trim_rows(((3.0, 1.0), (4.0, 2.0)), 0.5) == ((2.5, 1.0), (3.5, 2.0))


def test_a_later_departure_of_free_traffic_varies(whole: Suite) -> None:
    written = whole.select("i12_ins_sl_old_town")[0]
    _, roads = load_varied_scenario(whole, written, 0)
    edge = roads.lanes[written.egos[0].lanes[0]].edge
    cars = (
        BackgroundVehicle(id="now", depart_s=0.0, edges=(edge,)),
        BackgroundVehicle(id="later", depart_s=5.0, edges=(edge,)),
    )
    busy = written.model_copy(update={"background": written.background.model_copy(update={"vehicles": cars})})
    departures = [[one.depart_s for one in vary_scenario(busy, roads, seed).background.vehicles] for seed in SEEDS]
    assert {now for now, _ in departures} == {0.0}
    assert len({later for _, later in departures}) == len(SEEDS)
    assert all(abs(later - 5.0) <= BOUNDS.departure_s for _, later in departures)


def test_a_lane_change_of_a_log_is_not_cut_off(whole: Suite) -> None:
    """The schedule changes lanes at 1 m, 0.1 s after it begins; the log is trimmed less than that or not at all."""
    written = whole.select("i12_ins_sl_old_town")[0]
    _, roads = load_varied_scenario(whole, written, 0)
    edge = roads.lanes[written.egos[0].lanes[0]].edge
    schedule = Schedule(progress=((0.0, 0.0), (10.0, 100.0)), lanes=((1.0, 1),))
    car = BackgroundVehicle(id="logged", depart_s=0.0, edges=(edge,), schedule=schedule)
    busy = written.model_copy(update={"background": written.background.model_copy(update={"vehicles": (car,)})})
    for seed in SEEDS:
        found = vary_scenario(busy, roads, seed).background.vehicles[0].schedule
        assert found is not None
        assert found.progress[0][1] < 1.0


def shifted(scenario: Scenario, back_m: float, ahead_m: float) -> Scenario:
    return scenario.model_copy(update={"start_shift": CommonStartShift(back_m=back_m, ahead_m=ahead_m)})


def find_shifts(scenario: Scenario, written: Scenario) -> list[float]:
    """How much longer [m] the way of each CAV to its goal is than the written one."""
    lengths = [[float(Polyline(ego.xy).length) for ego in one.egos] for one in (scenario, written)]
    return [there - here for there, here in zip(*lengths, strict=True)]


def test_all_cavs_start_further_back_or_ahead_together(whole: Suite) -> None:
    (written,) = whole.select("i19_ins_sr_minor_road")
    roads = load_road_map(find_network_folder(written.network))
    wide = shifted(written, 12.0, 8.0)
    common: list[float] = []
    for seed in range(1, 21):
        shifts = find_shifts(vary_scenario(wide, roads, seed), written)
        assert max(shifts) - min(shifts) < 2 * BOUNDS.start.shift_m + 0.1
        assert -8.0 - BOUNDS.start.shift_m - 0.1 < min(shifts)
        assert max(shifts) < 12.0 + BOUNDS.start.shift_m + 0.1
        check_scenario(vary_scenario(wide, roads, seed), roads)
        common.append(sum(shifts) / len(shifts))
    assert min(common) < -6.0 and max(common) > 9.0
    assert vary_scenario(wide, roads, 0).egos == written.egos


def test_without_a_common_shift_starts_are_those_of_before(whole: Suite) -> None:
    (written,) = whole.select("i19_ins_sr_minor_road")
    roads = load_road_map(find_network_folder(written.network))
    assert "start_shift" not in written.model_dump_json()
    none = shifted(written, 0.0, 0.0)
    assert vary_scenario(none, roads, 3).egos == vary_scenario(written, roads, 3).egos


def test_a_common_shift_that_would_hit_something_is_smaller_for_all(whole: Suite) -> None:
    (written,) = whole.select("i19_ins_sr_minor_road")
    roads = load_road_map(find_network_folder(written.network))
    behind = written.egos[0].start
    wall = Actor(
        id="wall",
        kind="static",
        length=1.0,
        width=1.0,
        start=Pose(x=behind.x - 5.5 * math.cos(behind.yaw), y=behind.y - 5.5 * math.sin(behind.yaw), yaw=behind.yaw),
    )
    walled = shifted(written.model_copy(update={"actors": (wall,)}), 15.0, 0.0)
    for seed in range(1, 21):
        varied = vary_scenario(walled, roads, seed)
        assert not list(find_spawn_overlaps(varied, roads))
        assert max(find_shifts(varied, written)) < 3.0 * 2
