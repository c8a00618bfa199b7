"""The tracker: noise, misses, false positives, messages of all kinds, and the Kalman filter against matrices."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.message_samples import cams, cpms, mcms
from testing.planning import LENGTH, WIDTH, briefing, own, seen, things
from testing.sampling import examples

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, PROFILES
from mdrive_sumo.contract.reply_check import FARTHEST_M, are_within
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind
from mdrive_sumo.perception.measurements import MEASUREMENT, OWN_SENSOR, Measurements, Rows
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.perception.track_states import TRACK, correct, predict, start_tracks
from mdrive_sumo.perception.tracking_parameters import TRACKING
from mdrive_sumo.sensing.detection_noise import add_errors
from mdrive_sumo.v2x.messages import Cam, Cpm, Denm, Direction, EventCause, Intention, Mcm, ReferencePose, encode

REALISTIC = replace(briefing(), standard_detector=LIDAR_SINGLE)
LATENCY = PROFILES[LIDAR_SINGLE].latency_ticks
SIGMA = 0.2


def sent(content: Cam | Cpm | Mcm | Denm, sender: str, tick: int = 0) -> Message:
    message = encode(content)
    return Message(message.type, message.payload, sender, tick)


def cam(x: float, y: float, speed: float = 0.0, tick: int = 0, yaw: float = 0.0, turn: float = 0.0) -> Cam:
    return Cam(ReferencePose(x, y, yaw, tick, SIGMA, 0.0035), speed, 0.0, turn, LENGTH, WIDTH, 0.05)


def cpm(at: tuple[float, float], objects: Objects, tick: int = 0, age: int = 0) -> Cpm:
    count = len(objects.ids)
    sigmas = np.tile((0.15, 0.02, 0.5), (count, 1))
    pose = ReferencePose(*at, 0.0, tick, SIGMA, 0.0035)
    return Cpm(pose, 80.0, objects, np.full(count, age, dtype=np.uint8), sigmas=sigmas)


def run(
    tracker: ObjectTracker,
    ticks: Sequence[int],
    detect: Callable[[int], Objects],
    messages: Callable[[int], Sequence[Message]] = lambda _: (),
) -> dict[int, Objects]:
    """The tracker's output by tick; the own car stands in the origin."""
    found: dict[int, Objects] = {}
    for tick in ticks:
        tracker.receive(messages(tick))
        found[tick] = tracker.update(seen(tick, own(), detect(tick)))
    return found


def noisy(truth: Callable[[int], Objects], seed: int) -> Callable[[int], Objects]:
    """Detections of the surrogate detector, as late as it is."""
    return lambda tick: add_errors(PROFILES[LIDAR_SINGLE], seed, tick, truth(tick - LATENCY), (0.0, 0.0))


def place(x: float, y: float, speed: float, yaw: float = 0.0) -> Callable[[int], Objects]:
    return lambda tick: things(
        (x + speed * tick * DT * math.cos(yaw), y + speed * tick * DT * math.sin(yaw), yaw, speed)
    )


TICKS = range(0, 240, 4)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_standing_car_stands_although_detections_move(seed: int) -> None:
    found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), TICKS, noisy(place(12.0, 1.0, 0.0), seed))
    late = [found[tick] for tick in TICKS if tick >= 60]
    assert all(len(one) == 1 for one in found.values())
    assert np.mean([one.speed[0] == 0.0 for one in late]) > 0.9
    assert np.mean([math.hypot(one.x[0] - 12.0, one.y[0] - 1.0) for one in late]) < 0.15
    assert len({one.ids for one in found.values()}) == 1


@pytest.mark.parametrize(
    ("x", "y", "yaw", "tick"), [(9.0, 0.0, 0.0, 60), (9.0, 0.0, 1.6, 72), (9.0, 3.0, 0.0, 72), (14.0, 0.0, 0.0, 72)]
)
def test_only_a_vehicle_directly_ahead_is_reported_at_once(x: float, y: float, yaw: float, tick: int) -> None:
    """All others have to be seen for as long as a false positive lasts."""

    def detect(now: int) -> Objects:
        return place(x, y, 0.0, yaw)(now) if now >= 60 else things()

    found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), range(0, 80, 4), detect)
    assert min(now for now, objects in found.items() if objects.ids) == tick


def test_the_stated_sigma_of_a_position_grows_while_it_is_not_seen() -> None:
    tracker, sigmas = ObjectTracker(REALISTIC, LIDAR_SINGLE), dict[int, float]()
    for tick in range(0, 72, 4):
        objects = tracker.update(seen(tick, own(), place(8.0, 0.0, 0.0)(tick) if tick <= 60 else things()))
        (sigmas[tick],) = (tracker.position_sigmas[name] for name in objects.ids)
    assert 0.1 < sigmas[60] < 0.2 < sigmas[68]


@pytest.mark.parametrize(("speed", "most"), [(0.6, 0.15), (0.8, 0.05), (1.0, 0.02)])
def test_a_car_at_walking_pace_is_not_taken_for_a_standing_one(speed: float, most: float) -> None:
    """Before, the shares were 0.34, 0.16 and 0.07: cars in a queue held each other for standing, at old positions."""
    stands: list[bool] = []
    for seed in range(8):
        found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), TICKS, noisy(place(12.0, 1.0, speed, yaw=1.0), seed))
        stands += [found[tick].speed[0] == 0.0 for tick in TICKS if tick >= 60]
    assert np.mean(stands) < most


@pytest.mark.slow
def test_a_moving_car_is_known_better_than_it_is_measured() -> None:
    truth = place(-30.0, 8.0, 6.0)
    errors: list[tuple[float, float]] = []
    for seed in range(12):
        found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), range(0, 200, 4), noisy(truth, seed))
        assert all(len(one) == 1 for one in found.values())
        for tick in range(40, 200, 4):
            exact, one = truth(tick), found[tick]
            errors.append((math.hypot(one.x[0] - exact.x[0], one.y[0] - exact.y[0]), one.speed[0] - 6.0))
    position, speed = np.array(errors).T
    assert np.sqrt((speed**2).mean()) < 0.4 < PROFILES[LIDAR_SINGLE].speed_sigma
    assert np.sqrt((position**2).mean()) < 0.25


def test_a_missed_object_is_kept_and_a_gone_one_is_dropped() -> None:
    def detect(tick: int) -> Objects:
        return things() if 80 <= tick < 100 or tick >= 160 else place(15.0, 0.0, 0.0)(tick)

    found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), TICKS, detect)
    assert all(len(found[tick]) == 1 for tick in range(0, 160, 4))
    last_seen = 156
    gone = [tick for tick in TICKS if tick >= 160 and not found[tick].ids]
    assert gone[0] - last_seen == TRACKING.standing_coasting_ticks + 4
    assert not found[236].ids


def test_a_false_positive_of_half_a_second_is_never_reported_but_a_car_is() -> None:
    def detect(tick: int) -> Objects:
        ghost = [(20.0, 0.0, 0.0, 0.0)] if 60 <= tick < 70 else []
        car = [(40.0, 0.0, 0.0, 0.0)] if tick >= 60 else []
        return things(*ghost, *car, ids=[f"t{i:08x}" for i in range(len(ghost) + len(car))])

    found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), TICKS, detect)
    assert all(one.x.tolist() == pytest.approx([40.0], abs=0.5) or not one.ids for one in found.values())
    assert min(tick for tick in TICKS if found[tick].ids) == 72
    exact = run(ObjectTracker(briefing(), IDEAL), TICKS, place(40.0, 0.0, 0.0))
    assert exact[0].x.tolist() == pytest.approx([40.0])


def test_a_moving_car_is_reported_the_second_time() -> None:
    found = run(
        ObjectTracker(REALISTIC, LIDAR_SINGLE),
        TICKS,
        lambda tick: place(0.0, 30.0, 6.0)(tick) if tick >= 60 else things(),
    )
    assert min(tick for tick in TICKS if found[tick].ids) == 64


@pytest.mark.slow
@settings(max_examples=examples(8, 100))
@given(st.floats(-0.45, 0.45), st.floats(-0.45, 0.45), st.integers(0, 99))
def test_an_own_detection_and_a_cam_are_one_car_and_the_detection_says_where(dx: float, dy: float, seed: int) -> None:
    """The sender's estimate is off by up to 3 standard deviations of the difference of two estimates."""
    truth = place(25.0, 5.0, 0.0)
    found = run(
        ObjectTracker(REALISTIC, LIDAR_SINGLE),
        TICKS[:40],
        noisy(truth, seed),
        lambda tick: [sent(cam(25.0 + dx, 5.0 + dy, tick=tick), "cav_1", tick)],
    )
    late = [found[tick] for tick in TICKS[20:40]]
    assert all(one.ids == ("cav_1",) for one in late)
    assert np.mean([math.hypot(one.x[0] - 25.0, one.y[0] - 5.0) for one in late]) < 0.3


def test_what_only_messages_tell_is_tracked_and_named_by_the_station() -> None:
    """A bend at constant speed, CAMs at 5 Hz of which a third is lost, and 0.1 s old."""
    turn, speed = 0.3, 6.0

    def pose(tick: int) -> tuple[float, float, float]:
        yaw = turn * tick * DT
        return 30.0 + speed / turn * math.sin(yaw), 20.0 - speed / turn * math.cos(yaw), yaw

    def messages(tick: int) -> list[Message]:
        x, y, yaw = pose(max(tick - 2, 0))
        return [] if tick % 12 == 8 else [sent(cam(x, y, speed, max(tick - 2, 0), yaw, turn), "cav_2", tick)]

    found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), range(0, 120, 4), lambda _: things(), messages)
    for tick in range(8, 120, 4):
        x, y, yaw = pose(tick)
        assert found[tick].ids == ("cav_2",)
        assert math.hypot(found[tick].x[0] - x, found[tick].y[0] - y) < 0.3
        assert found[tick].yaw[0] == pytest.approx(yaw, abs=0.1)


def test_reports_of_two_stations_under_other_names_are_one_object() -> None:
    car = things((30.0, 20.0, 0.0, 0.0), ids=["t0000000a"])
    other = things((30.3, 19.8, 0.0, 0.0), ids=["t0000000b"])

    def messages(tick: int) -> list[Message]:
        first, second = cpm((20.0, 20.0), car, tick), cpm((40.0, 30.0), other, tick)
        return [sent(first, "rsu", tick), sent(second, "cav_3", tick)]

    found = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), TICKS[:20], lambda _: things(), messages)
    assert all(len(one) == 1 for one in found.values())


def test_two_cars_side_by_side_stay_two_and_a_pedestrian_is_no_car() -> None:
    cars = things((20.0, 0.0, 0.0, 5.0), (20.0, 3.5, 0.0, 5.0))
    walker = things((20.5, 1.7, 0.0, 0.0), kind=Kind.PEDESTRIAN, ids=["t0000000c"])
    found = run(ObjectTracker(briefing(), IDEAL), TICKS[:10], lambda tick: cars.advance(tick * DT).concat(walker))
    assert all(sorted(one.kind.tolist()) == [0, 0, 1] for one in found.values())


def test_reports_of_the_own_car_and_old_messages_count_for_nothing() -> None:
    tracker = ObjectTracker(REALISTIC, LIDAR_SINGLE)
    tracker.receive([sent(cpm((20.0, 0.0), things((0.5, 0.3, 0.0, 0.0))), "cav_1")])
    assert not tracker.update(seen(0, own(), things())).ids
    tracker.receive([sent(cam(30.0, 0.0, tick=0), "cav_1", 0)])
    assert not tracker.update(seen(TRACKING.memory_ticks + 4, own(), things())).ids


def test_poses_of_the_future_and_boxes_without_a_size_count_for_nothing() -> None:
    tracker, car = ObjectTracker(REALISTIC, LIDAR_SINGLE), things((30.0, 20.0, 0.0, 9.0))
    flat, thin = replace(car, length=np.zeros(1)), replace(car, width=np.zeros(1))
    reports = [cpm((20.0, 20.0), flat), cpm((20.0, 20.0), thin), cpm((20.0, 20.0), car, tick=2**32 - 1)]
    states = [replace(cam(30.0, 0.0), length=0.0), replace(cam(30.0, 0.0), width=0.0), cam(30.0, 0.0, 9.0, 2**31)]
    for i, content in enumerate((*reports, *states)):
        tracker.receive([sent(content, f"cav_{i}")])
    assert not tracker.update(seen(0, own(), things())).ids


@pytest.mark.slow
@given(st.lists(st.tuples(st.one_of(cams(), cpms(), mcms()), st.randoms(use_true_random=False)), max_size=4))
def test_whatever_stations_say_objects_are_boxes_that_an_agent_may_name(
    said: list[tuple[Cam | Cpm | Mcm, Random]],
) -> None:
    tracker = ObjectTracker(REALISTIC, LIDAR_SINGLE)
    for tick in range(4):
        for i, (content, chance) in enumerate(said):
            message = encode(replace(content, pose=replace(content.pose, tick=chance.choice((0, tick, 2**32 - 1)))))
            payload = bytearray(message.payload)
            for at in chance.choices(range(1, len(payload)), k=chance.choice((0, 1, 8))):
                payload[at] = chance.choice((0, 127, 128, 255))
            tracker.receive([Message(message.type, bytes(payload), f"cav_{i}", tick)])
        objects = tracker.update(seen(tick, own(), things()))
        boxes = np.column_stack((objects.x, objects.y, objects.yaw, objects.length, objects.width))
        assert are_within(boxes, FARTHEST_M) and (boxes[:, 3:] > 0.0).all()


def test_an_mcm_tells_where_its_sender_is_and_a_cam_of_that_tick_replaces_it() -> None:
    mcm = Mcm(ReferencePose(30.0, 0.0, 0.0, 0), 4.0, Intention.KEEP, Direction.FOLLOW, 0.2, np.zeros((1, 2)))
    for messages in ([mcm, cam(31.0, 0.0)], [cam(31.0, 0.0), mcm]):
        tracker = ObjectTracker(briefing(), IDEAL)
        tracker.receive([sent(one, "cav_1") for one in messages])
        assert tracker.update(seen(0, own(), things())).x.tolist() == pytest.approx([31.0])
    alone = ObjectTracker(briefing(), IDEAL)
    alone.receive([sent(mcm, "cav_1")])
    found = alone.update(seen(0, own(), things()))
    assert (found.ids, found.length.tolist()) == (("cav_1",), [LENGTH])


ETSI = replace(REALISTIC, v2x_rate="etsi")


def test_by_the_rules_of_etsi_an_object_that_one_station_tells_of_once_is_believed_at_once_and_kept() -> None:
    """A hidden car that stands is told of once a second, and one of these messages is lost."""
    hidden = things((30.0, 20.0, 0.0, 0.0))

    def messages(tick: int) -> list[Message]:
        return [sent(cpm((20.0, 20.0), hidden, tick), "cav_1", tick)] if tick in (40, 80) else []

    ticks = range(0, 160, 4)
    found = run(ObjectTracker(ETSI, LIDAR_SINGLE), ticks, lambda _: things(), messages)
    known = [tick for tick in ticks if found[tick].ids]
    assert known == list(range(40, known[-1] + 1, 4)) and known[-1] >= 80 + 2 * TICKS_PER_SECOND
    fixed = run(ObjectTracker(REALISTIC, LIDAR_SINGLE), ticks, lambda _: things(), messages)
    assert not any(objects.ids for objects in fixed.values())


def test_by_the_rules_of_etsi_all_cpms_since_the_last_update_count() -> None:
    tracker = ObjectTracker(ETSI, LIDAR_SINGLE)
    for tick in (0, 2):
        car = things((30.0 + 10.0 * tick, 20.0, 0.0, 0.0), ids=[f"t{tick:08x}"])
        tracker.receive([sent(cpm((20.0, 20.0), car, tick), name, tick) for name in ("cav_1", "cav_2")])
    assert sorted(tracker.update(seen(4, own(), things())).x.tolist()) == pytest.approx([30.0, 50.0])


def test_by_the_rules_of_etsi_an_own_detection_alone_is_believed_as_late_as_ever() -> None:
    for about in (ETSI, REALISTIC):
        tracker = ObjectTracker(about, LIDAR_SINGLE)
        found = run(tracker, range(0, 60, 4), lambda tick: things(*([(30.0, 20.0, 0.0, 0.0)] if tick >= 40 else [])))
        assert [tick for tick, objects in found.items() if objects.ids] == [52, 56]


def test_a_denm_tells_where_its_sender_is() -> None:
    pose = ReferencePose(30.0, 0.0, 0.0, 0)
    denm = Denm(pose, 0, EventCause.DANGEROUS_SITUATION, 1, 30.0, 0.0, 0, 1.0, 4.0, 5.0, 2.1)
    tracker = ObjectTracker(briefing(), IDEAL)
    tracker.receive([sent(denm, "cav_1")])
    found = tracker.update(seen(0, own(), things()))
    assert (found.ids, found.length.tolist(), found.speed.tolist()) == (("cav_1",), [5.0], [4.0])


def test_unreadable_messages_are_noted() -> None:
    (note,) = ObjectTracker(briefing(), IDEAL).receive([Message("cam", b"\x01" * 25, "cav_1")])
    assert (note.kind, note.text) == ("unreadable", "cam from cav_1: expected kind 4, found 1")


def test_the_order_of_messages_and_of_detections_does_not_matter() -> None:
    cars = things((20.0, 0.0, 0.0, 5.0), (24.0, 9.0, 0.0, 5.0), (14.0, -6.0, 0.0, 5.0))
    told = [sent(cam(40.0, 3.0), "cav_1"), sent(cam(50.0, 3.0), "cav_2"), sent(cpm((40.0, 3.0), cars), "cav_1")]
    one, two = ObjectTracker(REALISTIC, LIDAR_SINGLE), ObjectTracker(REALISTIC, LIDAR_SINGLE)
    one.receive(told)
    two.receive(told[::-1])
    first = one.update(seen(0, own(), cars))
    second = two.update(seen(0, own(), cars.take(np.array([2, 0, 1]))))
    assert first.x.tolist() == pytest.approx(second.x.tolist(), abs=1e-12)
    assert first.kind.tolist() == second.kind.tolist()


@given(st.integers(0, 10_000), st.floats(0.05, 0.5))
def test_the_filter_is_a_kalman_filter(seed: int, seconds: float) -> None:
    """Oracle: matrices for one axis of a car that drives along x; no bias."""
    rng = np.random.default_rng(seed)
    tracks = _start(_measure(rng, 0.0, 5.0))
    (track,) = tracks
    mean, covariance = np.array((track["x"], track["vx"])), np.diag((track["position"], track["velocity"]))
    forward = np.array(((1.0, seconds), (0.0, 1.0)))
    push = np.array((seconds**2 / 2, seconds))
    for step in range(1, 6):
        tracks["turn_rate"] = 0.0
        tracks = predict(tracks, seconds, TRACKING)
        mean = forward @ mean
        covariance = forward @ covariance @ forward.T + TRACKING.acceleration_sigma**2 * np.outer(push, push)
        (new,) = rows = _measure(rng, 5.0 * step * seconds, 5.0)
        noise = np.diag((new["position"], new["speed_variance"]))
        gain = covariance @ np.linalg.inv(covariance + noise)
        mean = mean + gain @ (np.array((new["x"], new["vx"])) - mean)
        covariance = (np.eye(2) - gain) @ covariance
        tracks = correct(tracks, FIRST, rows, FIRST, TRACKING)
        (track,) = tracks
        assert (track["x"], track["vx"]) == pytest.approx(tuple(mean))
        found = track["position"], track["coupling"], track["velocity"]
        assert found == pytest.approx((covariance[0, 0], covariance[0, 1], covariance[1, 1]))


def test_a_bias_is_never_averaged_away() -> None:
    new = _measure(np.random.default_rng(0), 0.0, 0.0)
    new["bias"] = 0.09
    tracks = _start(new)
    for _ in range(200):
        tracks = correct(predict(tracks, 0.2, TRACKING), FIRST, new, FIRST, TRACKING)
        assert tracks["position"][0] >= 0.09


FIRST = np.zeros(1, dtype=np.int64)


def _start(new: Rows) -> Rows:
    return start_tracks(np.zeros(0, TRACK), 0, 0, Measurements((OWN_SENSOR,), ("t0",), new), True, TRACKING)


def _measure(rng: np.random.Generator, x: float, speed: float) -> Rows:
    rows = np.zeros(1, MEASUREMENT)
    rows["x"], rows["vx"] = x + rng.normal(0, 0.2), speed + rng.normal(0, 0.5)
    rows["length"], rows["width"] = LENGTH, WIDTH
    rows["position"], rows["yaw_variance"], rows["speed_variance"] = rng.uniform(0.01, 0.2), 1e-4, 0.25
    return rows
