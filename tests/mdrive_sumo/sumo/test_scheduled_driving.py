"""Vehicles with a schedule: departure at the logged time, schedule keeping, and no racing when late."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.sampling import sampled
from testing.sumo_crossing import SIZE, compiled, scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Actors, EgoState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing, Schedule
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.sumo.schedule import CATCH_UP_FACTOR, MIN_CATCH_UP_SPEED, ScheduleTable

pytestmark = pytest.mark.slow

AWAY = EgoState(60, 60, 0, 0)
START_M = 20.0


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return compiled(tmp_path_factory.mktemp("cross"), "priority")


def profile(times: list[float], speeds: list[float], depart_s: float = 0.0) -> tuple[tuple[float, float], ...]:
    """A log at 5 Hz with those speeds, linear in between."""
    t = np.arange(0.0, times[-1] + 1e-9, 0.2)
    v = np.interp(t, times, speeds)
    s = np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2 * 0.2)))
    return tuple((round(float(a) + depart_s, 3), round(float(b), 2)) for a, b in zip(t, s, strict=True))


STOP_AND_GO = profile([0, 3, 6, 8, 10, 15], [8, 12, 0, 0, 5, 10])


def logged(
    progress: tuple[tuple[float, float], ...], name: str = "bg", edges: tuple[str, ...] = ("a", "b"), lane: int = 0,
    **more: object,
) -> BackgroundVehicle:  # fmt: skip
    (t0, s0), (t1, s1) = progress[:2]
    schedule = Schedule(progress=progress, **{key: more.pop(key) for key in ("lanes", "leaves") if key in more})
    return BackgroundVehicle(
        id=name, depart_s=t0, edges=edges, depart_lane=lane, depart_pos_m=START_M, depart_speed=(s1 - s0) / (t1 - t0),
        driving=CarFollowing(sigma=0), schedule=schedule, **more,
    )  # fmt: skip


def run(roads: RoadMap, vehicles: list[BackgroundVehicle], egos: list[EgoState | None]) -> list[Actors]:
    """Background vehicles in frame 0, 1, ... while the CAV is in those places (None: not there)."""
    states = [{"e": ego} if ego else {} for ego in egos]
    with SumoWorld(scenario(*vehicles), roads, {"e": SIZE}, seed=1) as world:
        frames = [world.start(states[0], Actors.empty()).actors]
        frames += [world.advance(state, Actors.empty(), ()).actors for state in states[1:]]
    return frames


def place(actors: Actors, name: str = "bg", axis: str = "x") -> float:
    """Distance along the route [m] of the front bumper from where it departed; NaN where it is not there."""
    if name not in actors.ids:
        return math.nan
    i = actors.ids.index(name)
    return float(getattr(actors, axis)[i] + actors.length[i] / 2) + 150.0 - START_M


def places(frames: list[Actors], name: str = "bg", axis: str = "x") -> Float:
    return np.array([place(frame, name, axis) for frame in frames])


def test_an_undisturbed_vehicle_keeps_to_its_schedule_within_half_a_metre(roads: RoadMap) -> None:
    found = places(run(roads, [logged(STOP_AND_GO)], [AWAY] * 300))
    ought = np.interp(np.arange(300) * DT, *np.array(STOP_AND_GO).T)
    assert np.abs(found - ought).max() < 0.5


def test_a_vehicle_departs_at_its_time_with_its_speed_however_near_the_next_is(roads: RoadMap) -> None:
    steady = profile([0, 5], [10, 10], depart_s=1.0)
    leader = BackgroundVehicle(
        id="l", depart_s=1.0, edges=("a", "b"), depart_pos_m=START_M + 5.6, depart_speed=10.0,
        schedule=Schedule(progress=steady),
    )  # fmt: skip
    frames = run(roads, [logged(steady), leader], [AWAY] * 25)
    assert [frame.ids for frame in frames[19:21]] == [(), ("bg", "l")]
    assert place(frames[20]) == pytest.approx(0.0, abs=1e-6)
    assert frames[20].speed == pytest.approx([10.0, 10.0])


def test_a_vehicle_faster_than_the_limit_departs_all_the_same(roads: RoadMap) -> None:
    frames = run(roads, [logged(profile([0, 5], [20, 20]))], [AWAY] * 60)
    assert frames[0].speed[0] == 20.0
    assert place(frames[-1]) == pytest.approx(20 * 59 * DT, abs=0.5)


def test_a_vehicle_does_not_depart_into_a_cav_but_waits(roads: RoadMap) -> None:
    there = EgoState(-150 + START_M, -4.8, 0, 0)
    frames = run(roads, [logged(profile([0, 5], [5, 5]))], [*[there] * 40, *[AWAY] * 40])
    assert all(not len(frame) for frame in frames[:40])
    assert frames[45].ids == ("bg",)


@pytest.mark.parametrize(("gap", "waits"), [(8.0, True), (9.5, False)])
def test_a_vehicle_does_not_depart_where_it_could_not_stop_any_more(roads: RoadMap, gap: float, waits: bool) -> None:
    cav = EgoState(-150 + START_M + gap + SIZE[0] / 2, -4.8, 0, 0)  # 10 m/s and 9 m/s2 need 5.6 m, 0.3 s 3 m
    frames = run(roads, [logged(profile([0, 5], [10, 10]))], [cav] * 100)
    assert len(frames[0]) == (not waits)
    assert all(place(frame) < gap for frame in frames if len(frame))


def test_it_brakes_as_hard_as_it_can_for_a_cav_that_cuts_in(roads: RoadMap) -> None:
    cav = EgoState(-150 + START_M + 36 + 12 + SIZE[0] / 2, -4.8, 0, 0)
    frames = run(roads, [logged(profile([0, 8], [12, 12]))], [*[AWAY] * 60, *[cav] * 100])
    assert place(frames[-1]) < 36 + 12  # 4.5 m/s2 would need 16 m


def test_it_leaves_where_and_when_its_schedule_ends(roads: RoadMap) -> None:
    frames = run(roads, [logged(profile([0, 4, 8], [10, 10, 0]))], [AWAY] * 190)
    gone = [len(frame) for frame in frames].index(0)
    assert gone * DT == pytest.approx(8.0, abs=0.1)
    assert place(frames[gone - 1]) == pytest.approx(60.0, abs=0.6)


def test_it_goes_on_at_the_limit_where_it_does_not_leave(roads: RoadMap) -> None:
    frames = run(roads, [logged(profile([0, 4], [5, 5]), leaves=False)], [AWAY] * 250)
    assert frames[-1].ids == ("bg",)
    assert frames[-1].speed[0] == pytest.approx(13.89, abs=0.1)


def test_held_up_by_a_cav_it_stops_and_then_does_not_race(roads: RoadMap) -> None:
    steady = profile([0, 20], [8, 8])
    cav = EgoState(-150 + START_M + 40, -4.8, 0, 0)
    frames = run(roads, [logged(steady)], [*[cav] * 240, *[AWAY] * 200])
    held, after = frames[:240], frames[240:]
    assert place(held[-1]) < 40 - SIZE[0] / 2
    assert held[-1].speed[0] < 0.1
    assert max(frame.speed[0] for frame in after if len(frame)) <= CATCH_UP_FACTOR * 8.0 + 0.05
    assert place(after[120]) > 60


def test_a_late_vehicle_does_not_wait_where_the_log_waited(roads: RoadMap) -> None:
    waits = profile([0, 2, 4, 10, 12, 20], [8, 8, 0.2, 0.2, 8, 8])
    cav = EgoState(-150 + START_M + 14, -4.8, 0, 0)
    frames = run(roads, [logged(waits)], [*[cav] * 240, *[AWAY] * 200])
    speeds = [frame.speed[0] for frame in frames[300:] if len(frame)]
    assert min(speeds) > 2.0


def test_a_vehicle_on_time_stands_until_the_log_goes_on(roads: RoadMap) -> None:
    frames = run(roads, [logged(profile([0, 2, 4, 10, 12, 20], [8, 8, 0, 0, 8, 8]))], [AWAY] * 300)
    speeds = np.array([frame.speed[0] for frame in frames if len(frame)])
    assert speeds[90:195].max() < 0.2
    assert speeds[215] > 1.0


@pytest.mark.parametrize(("begin", "end"), [(0, 1), (1, 0)])
def test_a_lane_change_happens_at_its_place_and_takes_its_time(roads: RoadMap, begin: int, end: int) -> None:
    change = logged(profile([0, 10], [10, 10]), lane=begin, lanes=((50.0, end),))
    frames = run(roads, [change], [AWAY] * 180)
    y = np.array([frame.y[0] for frame in frames])
    assert y[0] == pytest.approx((-4.8, -1.6)[begin], abs=0.05)
    assert y[-1] == pytest.approx((-4.8, -1.6)[end], abs=0.05)
    crossed = int(np.argmin(np.abs(y + 3.2)))
    assert place(frames[crossed]) == pytest.approx(50.0, abs=1.5)
    assert np.abs(np.diff(y)).max() < 0.12
    ought = np.interp(np.arange(180) * DT, *np.array(profile([0, 10], [10, 10])).T)
    assert np.abs(places(frames) - ought).max() < 0.5


def test_a_late_vehicle_is_not_stopped_where_its_schedule_ends(roads: RoadMap) -> None:
    cav = EgoState(-150 + START_M + 40, -4.8, 0, 0)
    frames = run(roads, [logged(profile([0, 12], [8, 8]))], [*[cav] * 240, *[AWAY] * 300])
    gone = [len(frame) for frame in frames].index(0)
    assert frames[gone - 1].speed[0] > 8.0
    assert place(frames[gone - 1]) == pytest.approx(96.0, abs=1.0)


def test_a_lane_change_waits_for_a_cav_beside_it(roads: RoadMap) -> None:
    change = logged(profile([0, 16], [8, 8]), lanes=((40.0, 1),))
    beside = [EgoState(-150 + START_M - 2.5 + 8.0 * i * DT, -1.6, 0.0, 8.0) for i in range(160)]
    frames = run(roads, [change], beside)
    apart = [frame.y[0] + 1.6 for frame in frames if len(frame)]
    assert max(apart) < -1.9 + 0.4  # its side stays out of the CAV's
    assert abs(apart[-1]) > 2.5


def test_a_lane_change_does_not_cut_into_a_faster_vehicle(roads: RoadMap) -> None:
    slow = logged(profile([0, 20], [4, 4]), lanes=((9.0, 1),))
    fast = BackgroundVehicle(
        id="f", depart_s=0, edges=("a", "b"), depart_lane=1, depart_pos_m=START_M - 16.0, depart_speed=12.0,
        driving=CarFollowing(sigma=0), schedule=Schedule(progress=profile([0, 20], [12, 12])),
    )  # fmt: skip
    frames = run(roads, [slow, fast], [AWAY] * 120)
    for frame in frames:
        if len(frame) == 2:
            i, j = frame.ids.index("bg"), frame.ids.index("f")
            apart_x, apart_y = abs(frame.x[i] - frame.x[j]), abs(frame.y[i] - frame.y[j])
            assert apart_x > 5.0 or apart_y > 1.8


def crossing(first: str) -> list[BackgroundVehicle]:
    """Eastbound traffic has the right of way, but the northbound car passed before it, or after."""
    north = profile([0, 15], [10, 10])
    at_crossing = 150.0 - START_M
    lag = 0.9 if first == "north" else -0.9
    east = profile([0, 15], [10 * (at_crossing - 10 * lag) / at_crossing] * 2)
    return [logged(north, "north", ("c", "d")), logged(east, "east", ("a", "b"))]


@pytest.mark.parametrize("first", ["north", "east"])
def test_undisturbed_traffic_keeps_the_order_of_the_log_through_a_junction(roads: RoadMap, first: str) -> None:
    frames = run(roads, crossing(first), [AWAY] * 300)
    passed = {
        name: int(np.argmax(places(frames, name, axis) > 150 - START_M))
        for name, axis in (("north", "y"), ("east", "x"))
    }
    assert min(passed, key=lambda name: passed[name]) == first
    ought = np.interp(np.arange(200) * DT, *np.array(profile([0, 15], [10, 10])).T)
    assert np.abs(places(frames[:200], "north", "y") - ought).max() < 0.5


def test_a_vehicle_follows_its_log_into_a_junction_that_it_cannot_leave(roads: RoadMap) -> None:
    """SUMO would keep the junction clear behind a leader that stands right beyond it."""
    beyond = roads.lanes["b_0"].centre.xy[0, 0] + 1.0 + 5.0
    leader = logged(profile([0, 20], [0.001, 0.001]), "l", ("b",)).model_copy(update={"depart_pos_m": 6.0})
    until = (beyond + 150 - START_M - 5.0 - 3.0) / 9.0
    stops = profile([0, until - 2.0, until + 2.0, 20], [9, 9, 0, 0])
    frames = run(roads, [logged(stops), leader], [AWAY] * 380)
    assert place(frames[-1]) == pytest.approx(stops[-1][1], abs=1.0)


@pytest.mark.parametrize("step", sampled((10, 30), (30,)))
def test_a_vehicle_on_schedule_yields_to_one_that_is_late_and_has_the_right_of_way(roads: RoadMap, step: int) -> None:
    """The northbound car would pass long after the eastbound one, which a CAV holds up until they would meet."""
    east = logged(profile([0, 25], [10, 10]), "east", lane=1)
    north = logged(profile([0, 25], [6.5, 6.5]), "north", ("c", "d"))
    on_lane_1 = EgoState(-150 + START_M + 40, -1.6, 0, 0)
    nearest = 100.0
    for hold in range(100, 201, step):
        frames = run(roads, [east, north], [*[on_lane_1] * hold, *[AWAY] * (480 - hold)])
        apart = [math.hypot(f.x[0] - f.x[1], f.y[0] - f.y[1]) for f in frames if len(f) == 2]
        nearest = min(nearest, *apart)
    assert nearest > 3.5


def test_a_cav_that_stands_in_the_junction_is_not_run_over(roads: RoadMap) -> None:
    x = float(roads.lanes["c_0"].centre.xy[0, 0])
    frames = run(roads, [logged(profile([0, 20], [12, 12]), edges=("c", "d"))], [EgoState(x, -3.0, 0.0, 0.0)] * 400)
    assert max(frame.y[0] for frame in frames) + 2.5 < -3.0 - SIZE[1] / 2
    assert frames[-1].speed[0] < 0.1


def test_departing_off_the_road_is_the_files_fault(roads: RoadMap) -> None:
    with pytest.raises(InputError, match="vehicle bg: expected a driving lane to depart on, found lane 7 of a"):
        SumoWorld(scenario(logged(STOP_AND_GO, lane=7)), roads, {"e": SIZE}, seed=1).__enter__()


def test_a_schedule_that_begins_in_a_junction_begins_there(roads: RoadMap) -> None:
    length = 150.0 - 10.0
    inside = tuple((t, s + 15.0) for t, s in profile([0, 5], [6, 6]))
    vehicle = logged(inside, edges=("c", "d")).model_copy(update={"depart_pos_m": length})
    frames = run(roads, [vehicle], [AWAY] * 60)
    assert -10.0 < frames[0].y[0] + 2.5 < 10.0
    moved = np.array([frame.y[0] for frame in frames])
    assert np.abs(moved - moved[0] - 6 * DT * np.arange(60)).max() < 0.5


def test_sizes_and_types_of_their_own(roads: RoadMap) -> None:
    lorry = BackgroundVehicle(id="t", depart_s=0, edges=("a",), depart_pos_m=30, length=12.0, width=2.5)
    frames = run(roads, [logged(STOP_AND_GO).model_copy(update={"length": 4.2, "width": 1.7}), lorry], [AWAY] * 2)
    assert frames[0].ids == ("bg", "t")
    assert frames[0].length.tolist() == [4.2, 12.0]
    assert frames[0].width.tolist() == [1.7, 2.5]


@given(st.lists(st.floats(0.0, 15.0), min_size=3, max_size=12), st.integers(-1, 500), st.floats(-5.0, 200.0))
def test_the_desired_speed_is_bounded_by_the_logs_at_that_place(speeds: list[float], tick: int, at: float) -> None:
    times = [2.0 * i for i in range(len(speeds))]
    table = ScheduleTable(Schedule(progress=profile(times, speeds)))
    assert (
        0.0 <= table.compute_desired_speed(tick, at) <= max(CATCH_UP_FACTOR * (max(speeds) + 0.1), MIN_CATCH_UP_SPEED)
    )
    assert all(b >= a for a, b in pairwise(table.find_position(t) for t in range(-1, table.ends_tick + 5)))
