"""Which objects a CPM has: by hand-made detections, and for any."""

from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from testing.planning import things

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, PROFILES
from mdrive_sumo.core.state import Kind
from mdrive_sumo.v2x.services.cpm_rule import CpmRule

Detect = Callable[[int], Objects]


def tell(detect: Detect, ticks: range, profile: str = IDEAL, capacity: int = 50) -> dict[int, tuple[str, ...]]:
    """Ticks of CPMs -> names of their objects, in order."""
    rule = CpmRule(PROFILES[profile])
    told: dict[int, tuple[str, ...]] = {}
    for tick in ticks:
        objects = detect(tick)
        due = rule.check(tick, objects, capacity)
        if due is not None:
            told[tick] = tuple(objects.ids[row] for row in due.rows.tolist())
    return told


def drive(speed: float, name: str = "t00000001") -> Detect:
    return lambda tick: things((speed * tick / 20, 0.0, 0.0, speed), ids=[name])


def test_a_standing_object_is_told_of_once_a_second_and_a_moving_one_every_4_metres() -> None:
    assert [*tell(drive(0.0), range(0, 60, 2))] == [0, 20, 40]
    with_objects = [tick for tick, names in tell(drive(10.0), range(0, 40, 2)).items() if names]
    assert with_objects == [0, 10, 20, 30]


def test_free_sight_goes_out_once_a_second_also_without_objects() -> None:
    assert tell(lambda _: things(), range(0, 41, 2)) == {0: (), 20: (), 40: ()}


def test_pedestrians_go_out_together_as_soon_as_one_is_due() -> None:
    first = things((5.0, 0.0, 0.0, 0.0), kind=Kind.PEDESTRIAN, ids=["t00000001"])
    both = first.concat(things((5.0, 3.0, 0.0, 0.0), kind=Kind.CYCLIST, ids=["t00000002"]))
    told = tell(lambda tick: first if tick < 6 else both, range(0, 28, 2))
    names = both.ids
    assert told == {0: names[:1], 6: names[::-1], 16: names, 20: (), 26: names}


def test_the_most_useful_objects_go_first_and_the_others_next_time() -> None:
    car = things((2.0, 0.0, 0.0, 0.0), ids=["t00000001"])
    new = things((60.0, 0.0, 0.0, 0.0), (50.0, 0.0, 0.0, 0.0), ids=["t00000002", "t00000003"])
    walker = things((70.0, 0.0, 0.0, 0.0), kind=Kind.PEDESTRIAN, ids=["t00000004"])
    every = car.concat(new).concat(walker)
    told = tell(lambda tick: car if tick < 20 else every, range(0, 24, 2), capacity=2)
    assert told == {0: ("t00000001",), 20: ("t00000004", "t00000002"), 22: ("t00000003", "t00000001")}


def test_what_may_be_a_false_positive_is_told_of_after_half_a_second() -> None:
    def appear(speed: float) -> Detect:
        return lambda tick: things() if tick < 30 else things((20.0, 0.0, 0.0, speed), ids=["t00000001"])

    def first(speed: float, profile: str) -> int:
        return next(tick for tick, names in tell(appear(speed), range(0, 60, 2), profile).items() if names)

    assert (first(0.0, IDEAL), first(0.0, LIDAR_SINGLE), first(3.0, LIDAR_SINGLE)) == (30, 42, 32)


def test_errors_of_the_detector_trigger_nothing_and_its_motion_does() -> None:
    def feign(error: float) -> Detect:
        return lambda tick: things((20.0, 0.0, 0.0, error * (tick % 4)), ids=["t00000001"])

    assert [*tell(feign(0.6), range(0, 22, 2), LIDAR_SINGLE)] == [0, 20]
    assert [*tell(feign(0.6), range(0, 6, 2), IDEAL)] == [0, 2, 4]
    assert [*tell(feign(2.0), range(0, 6, 2), LIDAR_SINGLE)] == [0, 2, 4]


def test_congestion_control_makes_the_interval_longer() -> None:
    rule, objects = CpmRule(PROFILES[IDEAL]), drive(30.0)
    assert [tick for tick in range(30) if rule.check(tick, objects(tick), 9, dcc_ticks=9)] == [0, 9, 18, 27]


@given(st.integers(0, 9999), st.integers(1, 4))
def test_every_object_is_told_of_within_a_second_if_it_fits(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    names = [f"t{i:08x}" for i in range(count)]
    rows = {tick: rng.uniform(-5.0, 5.0, (count, 4)) for tick in range(0, 80, 2)}
    told = tell(lambda tick: things(*rows[tick].tolist(), ids=names), range(0, 80, 2))
    gaps = np.diff([*told])
    assert (gaps >= 2).all() and all(len(set(one)) == len(one) for one in told.values())
    for name in names:
        assert (np.diff([tick for tick, objects in told.items() if name in objects]) <= 20).all()
