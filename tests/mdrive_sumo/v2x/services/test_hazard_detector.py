"""What a car warns of, by hand-made situations."""

import math
from dataclasses import replace

import pytest
from testing.planning import briefing, own, seen, things

from mdrive_sumo.contract import Objects, OwnState, TrafficLight
from mdrive_sumo.core.state import Kind
from mdrive_sumo.v2x.messages import EventCause
from mdrive_sumo.v2x.services.hazard_detector import CROSSING, LONGITUDINAL, VULNERABLE, HazardDetector

NOTHING = things()
LIT = replace(briefing(), traffic_lights=(TrafficLight("x", 30.0),))


def find_risk(state: OwnState, objects: Objects) -> tuple[int, float] | None:
    """Return the sub cause and the x of a risk of collision."""
    hazards = HazardDetector(briefing()).detect(seen(0, state, objects), objects)
    return next(((one.sub_cause, one.x) for one in hazards if one.cause is EventCause.COLLISION_RISK), None)


@pytest.mark.parametrize(
    ("signal", "ahead", "warns"),
    [("g", NOTHING, True), ("r", NOTHING, False), ("g", things((18.0, 0.2, 0.0, 0.0)), False)],
)
def test_a_car_that_stands_for_long_and_for_no_reason_warns(signal: str, ahead: Objects, warns: bool) -> None:
    detector, found = HazardDetector(LIT), dict[int, bool]()
    for tick in range(0, 220, 2):
        observation = replace(seen(tick, own(10.0), ahead), signals={"x": signal})
        found[tick] = bool(detector.detect(observation, ahead))
    assert not found[198] and found[200] is warns
    assert not detector.detect(seen(220, own(10.0, speed=1.0), NOTHING), NOTHING)


def test_emergency_braking_begins_at_6_and_ends_below_two_and_a_half() -> None:
    detector, decelerations = HazardDetector(briefing()), (5.9, 6.0, 3.0, 2.4, 5.9)
    states = [replace(own(speed=8.0), acceleration=-deceleration) for deceleration in decelerations]
    found = [bool(detector.detect(seen(tick, state, NOTHING), NOTHING)) for tick, state in enumerate(states)]
    assert found == [False, True, True, False, False]
    slow = replace(own(speed=5.5), acceleration=-7.0)
    assert not HazardDetector(briefing()).detect(seen(0, slow, NOTHING), NOTHING)


def test_a_collision_within_one_and_a_half_seconds_is_a_risk() -> None:
    # Bumper to bumper: 4.5 m between centres; at 10 m/s 15 m in 1.5 s.
    assert find_risk(own(speed=10.0), things((19.0, 0.0, 0.0, 0.0))) == (LONGITUDINAL, pytest.approx(15.0))
    assert find_risk(own(speed=10.0), things((19.6, 0.0, 0.0, 0.0))) is None
    assert find_risk(own(speed=10.0), things((19.0, 3.5, math.pi, 10.0))) is None  # in the next lane
    crossing = things((12.0, 10.0, -math.pi / 2, 9.0))
    assert find_risk(own(speed=10.0), crossing) == (CROSSING, pytest.approx(10.0, abs=2.0))
    walker = things((12.0, 1.5, -math.pi / 2, 1.0), kind=Kind.PEDESTRIAN)
    risk = find_risk(own(speed=10.0), walker)
    assert risk is not None and risk[0] == VULNERABLE
    assert find_risk(own(speed=0.0), things((4.0, 0.0, 0.0, 0.0))) is None


def test_a_car_that_will_stop_in_time_or_turns_away_is_in_no_risk() -> None:
    ahead = things((16.0, 0.0, 0.0, 0.0))
    assert find_risk(own(speed=10.0), ahead) is not None
    assert find_risk(replace(own(speed=10.0), acceleration=-6.0), ahead) is None  # 8.3 m to a stop
    assert find_risk(replace(own(speed=10.0), yaw_rate=0.6), ahead) is None


def test_a_risk_stays_for_half_a_second() -> None:
    detector, ahead = HazardDetector(briefing()), things((12.0, 0.0, 0.0, 0.0))
    present = [
        bool(detector.detect(seen(tick, own(speed=10.0), ahead), ahead if not tick else NOTHING))
        for tick in range(0, 14, 2)
    ]
    assert present == [True] * 6 + [False]
