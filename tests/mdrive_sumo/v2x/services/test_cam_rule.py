"""When a CAM is due: by hand-computed drives, and for any motion."""

import math
from collections.abc import Callable
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.v2x.services.cam_rule import CamRule, StationMotion
from mdrive_sumo.v2x.services.motion_thresholds import MOTION_THRESHOLDS

Motion = Callable[[int], StationMotion]


def send(motion: Motion, ticks: range, dcc_ticks: int = 0) -> dict[int, bool]:
    """Ticks of CAMs -> whether they have the low-frequency container."""
    rule = CamRule()
    due = {tick: rule.check(tick, motion(tick), dcc_ticks) for tick in ticks}
    return {tick: cam.has_low_frequency for tick, cam in due.items() if cam is not None}


def straight(speed: float) -> Motion:
    return lambda tick: StationMotion(speed * tick / 20, 0.0, 0.0, speed)


def test_a_standing_car_sends_once_a_second() -> None:
    assert send(straight(0.0), range(0, 100, 2)) == dict.fromkeys(range(0, 100, 20), True)


def test_a_car_at_constant_speed_sends_every_4_metres_and_the_low_frequency_container_every_500_ms() -> None:
    # At 10 m/s 4 m are exceeded after 9 ticks, of which only even ones are asked: 10. At 20 m/s after 5: 6.
    assert send(straight(10.0), range(0, 61, 2)) == dict.fromkeys(range(0, 61, 10), True)
    assert send(straight(20.0), range(0, 30, 2)) == {0: True, 6: False, 12: True, 18: False, 24: True}


def test_the_interval_of_a_trigger_stays_for_three_cams() -> None:
    def brake_once(tick: int) -> StationMotion:
        return StationMotion(0.0, 0.0, 0.0, 1.0 if tick < 4 else 0.0)

    assert [*send(brake_once, range(0, 60, 2))] == [0, 4, 8, 12, 16, 36, 56]


def test_a_turn_across_the_end_of_the_circle_is_measured_the_short_way() -> None:
    def turn(degrees: float) -> Motion:
        end = -math.pi + math.radians(degrees)
        return lambda tick: StationMotion(0.0, 0.0, math.pi - 0.01 if tick < 2 else end, 5.0)

    assert 2 not in send(turn(3.0), range(0, 4, 2))
    assert 2 in send(turn(4.0), range(0, 4, 2))


def test_congestion_control_makes_the_interval_longer_up_to_a_second() -> None:
    assert [*send(straight(30.0), range(0, 30), dcc_ticks=7)] == [0, 7, 14, 21, 28]
    assert [*send(straight(30.0), range(0, 50), dcc_ticks=1000)] == [0, 20, 40]


@given(st.lists(st.tuples(*(st.floats(-3.0, 3.0),) * 4), min_size=80, max_size=80))
def test_any_motion_is_told_in_100_ms_to_a_second_and_never_later_than_its_trigger(
    motions: list[tuple[float, float, float, float]],
) -> None:
    told = [StationMotion(*motion) for motion in motions]
    ticks = [*send(told.__getitem__, range(len(told)))]
    gaps = [later - earlier for earlier, later in pairwise(ticks)]
    assert ticks[0] == 0 and all(2 <= gap <= 20 for gap in gaps) and len(told) - ticks[-1] <= 20
    for last, later in zip(ticks, [*ticks[1:], len(told)], strict=True):
        for silent in range(last + 2, later):
            before, now = told[last], told[silent]
            assert math.dist((before.x, before.y), (now.x, now.y)) <= MOTION_THRESHOLDS.distance_m + 1e-9
            assert abs(before.speed - now.speed) <= MOTION_THRESHOLDS.speed
