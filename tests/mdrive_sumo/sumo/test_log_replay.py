"""Traffic modes with logs: `replay` never reacts, `hybrid` reacts once a CAV disturbs it."""

import math

import numpy as np
import pytest
from testing.sumo_crossing import SIZE, car, compiled, overlap, scenario

from mdrive_sumo.core.state import DT, Actors, EgoState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundMode, BackgroundVehicle, CarFollowing, Schedule
from mdrive_sumo.sumo import SumoWorld

AWAY = EgoState(60, 60, 0, 0)
FRONT_M = 20.0
LENGTH = 5.0


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return compiled(tmp_path_factory.mktemp("cross"), "priority")


def logged(speed: float = 10.0, until_s: float = 15.0, aside: float = 0.3, name: str = "bg") -> BackgroundVehicle:
    """Eastbound on the right lane with a log that swings a little; x of the centre is 127.5 m west of the crossing."""
    times = np.arange(0.0, until_s + 1e-9, 0.1)
    x, y = -150 + FRONT_M - LENGTH / 2 + speed * times, -4.8 + aside * np.sin(times)
    log = tuple((round(float(t), 3), float(a), float(b), 0.02) for t, a, b in zip(times, x, y, strict=True))
    progress = tuple((round(float(t), 3), round(float(speed * t), 2)) for t in times[::2])
    return BackgroundVehicle(
        id=name, depart_s=0, edges=("a", "b"), depart_pos_m=FRONT_M, depart_speed=speed, length=LENGTH,
        driving=CarFollowing(sigma=0), schedule=Schedule(progress=progress), log=log,
    )  # fmt: skip


def run(roads: RoadMap, mode: BackgroundMode, vehicles: list[BackgroundVehicle], egos: list[EgoState]) -> list[Actors]:
    with SumoWorld(scenario(*vehicles, mode=mode), roads, {"e": SIZE}, seed=1) as world:
        frames = [world.start({"e": egos[0]}, Actors.empty()).actors]
        return frames + [world.advance({"e": ego}, Actors.empty(), ()).actors for ego in egos[1:]]


def errors(frames: list[Actors], vehicle: BackgroundVehicle) -> list[float]:
    """Distances [m] from the log, as long as the vehicle is there."""
    t, x, y, _ = np.array(vehicle.log).T
    now = np.arange(len(frames)) * DT
    at = np.interp(now, t, x), np.interp(now, t, y)
    rows = ((i, frame.ids.index(vehicle.id), frame) for i, frame in enumerate(frames) if vehicle.id in frame.ids)
    return [math.hypot(frame.x[j] - at[0][i], frame.y[j] - at[1][i]) for i, j, frame in rows]


@pytest.mark.slow
def test_replay_is_the_log_to_a_millimetre_whatever_stands_there(roads: RoadMap) -> None:
    vehicle = logged()
    frames = run(roads, "replay", [vehicle], [EgoState(-60.0, -4.8, 0.0, 0.0)] * 330)
    assert max(errors(frames, vehicle)) < 1e-3
    assert [len(frame) for frame in frames] == [1] * 301 + [0] * 29
    assert frames[100].speed[0] == pytest.approx(10.0, abs=0.05)
    assert (frames[0].length[0], frames[0].yaw[0]) == (LENGTH, pytest.approx(0.02))


def test_replay_needs_no_road(roads: RoadMap) -> None:
    vehicle = logged().model_copy(update={"edges": ("nowhere",)})
    frames = run(roads, "replay", [vehicle, logged(5.0, name="a")], [AWAY] * 100)
    assert max(errors(frames, vehicle)) < 1e-3
    assert frames[50].ids == ("a", "bg")
    assert frames[50].ids is frames[60].ids


@pytest.mark.slow
def test_hybrid_is_replay_where_no_cav_comes_in_the_way(roads: RoadMap) -> None:
    vehicles = [
        logged(),
        logged(8.0, aside=0.1, name="behind").model_copy(update={"log": logged(8.0, 15.0, 0.1).log[20:]}),
    ]
    beside = [EgoState(-150 + 10.0 * i * DT, -1.6 + 0.4, 0.0, 10.0) for i in range(250)]
    assert_same(run(roads, "hybrid", vehicles, beside), run(roads, "replay", vehicles, beside))


@pytest.mark.slow
def test_a_cav_that_brakes_behind_or_drives_off_in_front_releases_no_vehicle(roads: RoadMap) -> None:
    """As in a queue of a log: the CAV stops behind a slow vehicle; and it starts just before the vehicle behind it."""
    slow = logged(4.0)
    x, speed, braking = -150.0, 10.0, []
    for _ in range(250):
        braking.append(EgoState(x, -4.8, 0.0, speed))
        speed = max(speed - (2.0 * DT if speed > 4.0 else 0.0), 4.0)
        x += speed * DT
    gap = min(slow.log[0][1] + 4.0 * i * DT - state.x for i, state in enumerate(braking))
    assert gap > LENGTH / 2 + SIZE[0] / 2  # they do not touch
    assert_same(run(roads, "hybrid", [slow], braking), run(roads, "replay", [slow], braking))
    away = [EgoState(-150 + FRONT_M + 4.0 + (i * DT) ** 2, -4.8, 0.0, 2 * i * DT) for i in range(200)]
    starting = starting_behind()
    assert_same(run(roads, "hybrid", [starting], away), run(roads, "replay", [starting], away))


def starting_behind() -> BackgroundVehicle:
    """A log that stands for 1 s and then drives off with 2 m/s2, up to 8 m/s."""
    moved = logged(0.0, 10.0, 0.0)
    log = tuple(
        (t, x + max(t - 1.0, 0.0) ** 2 if t < 5 else x + 16 + 8 * (t - 5), y, yaw) for t, x, y, yaw in moved.log
    )
    return moved.model_copy(update={"log": log})


def assert_same(found: list[Actors], wanted: list[Actors]) -> None:
    for one, other in zip(found, wanted, strict=True):
        assert one.ids == other.ids
        assert np.array_equal(one.x, other.x)
        assert np.array_equal(one.y, other.y)
        assert np.array_equal(one.yaw, other.yaw)


@pytest.mark.slow
def test_hybrid_stops_for_a_cav_in_the_way_and_replay_does_not(roads: RoadMap) -> None:
    ego = EgoState(-60.0, -4.8, 0.0, 0.0)
    hit = {
        mode: sum(overlap(ego, frame) for frame in run(roads, mode, [logged()], [ego] * 300))
        for mode in ("hybrid", "replay")
    }
    assert hit["hybrid"] == 0
    assert hit["replay"] > 0


def test_a_released_vehicle_sees_ghosts_at_once(roads: RoadMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """The CAV comes, over two lanes, in a tick between those in which lanes are looked for."""
    from mdrive_sumo.sumo import ghost_manager

    placed: list[str] = []
    real = ghost_manager.add_placed_vehicle

    def noted(name: str, *rest: object) -> None:
        placed.append(name)
        real(name, *rest)

    monkeypatch.setattr(ghost_manager, "add_placed_vehicle", noted)
    run(roads, "hybrid", [logged()], [*[AWAY] * 101, EgoState(-60.0, -3.2, 0.0, 0.0)])
    assert any(name.startswith("ghost:ego:e:") for name in placed)


@pytest.mark.slow
def test_a_release_is_no_jump_and_for_good(roads: RoadMap) -> None:
    cav = EgoState(-60.0, -4.8, 0.0, 0.0)
    frames = run(roads, "hybrid", [logged()], [*[cav] * 200, *[AWAY] * 300])
    x, y = (np.array([getattr(frame, axis)[0] for frame in frames if len(frame)]) for axis in "xy")
    assert np.abs(np.diff(x)).max() < 12.0 * DT + 1e-6
    assert np.abs(np.diff(y)).max() < 0.1
    assert frames[199].speed[0] < 0.1
    assert max(frame.speed[0] for frame in frames[200:] if len(frame)) == pytest.approx(12.0, abs=0.1)


@pytest.mark.slow
def test_a_vehicle_about_to_hit_a_released_vehicle_is_released_as_well(roads: RoadMap) -> None:
    """The CAV is gone before the second, fast vehicle comes near; the first one has just begun to drive again."""
    first, second = logged(), logged(20.0, name="second")
    second = second.model_copy(update={"log": tuple((t, x - 167.5, y, yaw) for t, x, y, yaw in second.log)})
    cav = EgoState(-60.0, -4.8, 0.0, 0.0)
    egos = [*[cav] * 170, *[AWAY] * 110]
    frames, alone = (run(roads, mode, [first, second], egos) for mode in ("hybrid", "replay"))
    for frame in frames:
        assert abs(frame.x[0] - frame.x[1]) > LENGTH
    assert frames[165].x[1] == alone[165].x[1]
    braking = -np.diff([frame.speed[1] for frame in frames]) / DT
    assert braking.max() < 5.0  # released in good time
    assert frames[-1].x[1] < alone[-1].x[1] - 10.0


def test_vehicles_without_a_log_react_to_those_on_theirs(roads: RoadMap) -> None:
    slow = logged(4.0, 25.0)
    follower = car("f", pos=5.0, speed=12.0)
    frames = run(roads, "hybrid", [slow, follower], [AWAY] * 200)
    assert max(errors(frames, slow)) < 1e-3
    for frame in frames:
        if len(frame) == 2:
            boxes = frame.x[frame.ids.index("bg")] - frame.x[frame.ids.index("f")]
            assert abs(boxes) > LENGTH or abs(frame.y[0] - frame.y[1]) > 1.8


def test_a_vehicle_that_appears_in_a_cav_waits_until_it_has_gone(roads: RoadMap) -> None:
    there = EgoState(-150 + FRONT_M - LENGTH / 2, -4.8, 0, 0)
    frames = run(roads, "hybrid", [logged()], [*[there] * 40, *[AWAY] * 40])
    assert all(not len(frame) for frame in frames[:40])
    assert frames[45].ids == ("bg",)


def test_a_log_off_the_road_is_replayed_for_good(roads: RoadMap) -> None:
    vehicle = logged()
    off = tuple((t, x, y - 30.0, yaw) for t, x, y, yaw in vehicle.log)
    vehicle = vehicle.model_copy(update={"log": off})
    frames = run(roads, "hybrid", [vehicle], [EgoState(-60.0, -34.8, 0.0, 0.0)] * 200)
    assert max(errors(frames, vehicle)) < 1e-3


def test_the_same_traffic_every_time(roads: RoadMap) -> None:
    cav = [EgoState(-60.0, -4.8, 0.0, 0.0)] * 200
    assert_same(run(roads, "hybrid", [logged()], cav), run(roads, "hybrid", [logged()], cav))
