"""Scripted drivers react when they are said to, see what they can see, and drive the same by seed."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.planning import briefing, own, seen, straight, things

from mdrive_sumo.contract import Control, Objects
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.study.human.scripted_driver import (
    AXIS_STEPS,
    DISTRACTED,
    DRIVER_KINDS,
    PEDAL_RATE,
    WHEEL_RATE,
    GlancePattern,
    ScriptedDriver,
    extrapolate,
    find_traits,
)
from mdrive_sumo.v2x.content import Cam, ReferencePose
from mdrive_sumo.v2x.messages import encode

NOTHING = things()
SPEED = 8.0


def drive(kind: str, objects: Sequence[Objects], name: str = "", speed: float = SPEED, seed: int = 1) -> list[Control]:
    """The controls of a driver on a straight road, whose car rolls on at one speed whatever the driver does."""
    driver = ScriptedDriver(kind, has_v2x_view=True, name=name)
    driver.start(briefing(straight(200.0), seed=seed))
    return [driver.act(seen(tick, own(x=speed * DT * tick, speed=speed), there)) for tick, there in enumerate(objects)]


@pytest.mark.parametrize("kind", DRIVER_KINDS)
@pytest.mark.parametrize("appears", [2, 6])
def test_the_first_reaction_comes_after_the_stated_time(kind: str, appears: int) -> None:
    """A car that stands on the road appears: what pedals do differs from then on, and not before."""
    reaction = round(find_traits(kind).reaction_s * TICKS_PER_SECOND)
    ticks = appears + reaction + 2
    obstacle = things((40.0, 0.0, 0.0, 0.0))
    free = drive(kind, [NOTHING] * ticks)
    braked = drive(kind, [NOTHING] * appears + [obstacle] * (ticks - appears))
    differ = [tick for tick in range(ticks) if free[tick] != braked[tick]]
    assert differ[0] == appears + reaction
    assert braked[differ[0]].throttle < free[differ[0]].throttle or braked[differ[0]].brake > 0


def test_reaction_times_are_those_that_are_stated() -> None:
    assert {kind: traits.reaction_s for kind, traits in DRIVER_KINDS.items()} == {
        "attentive": 0.8,
        "distracted": 1.5,
        "impatient": 0.8,
    }


def test_what_appears_during_a_glance_is_seen_after_it() -> None:
    """The distracted driver looks away; until the eyes are back and the reaction time is over, nothing changes."""
    pattern = GlancePattern(DISTRACTED, seed=0)
    ticks = 400
    away = [pattern.is_away(tick) for tick in range(ticks)]
    lengths: list[int] = []
    for before, now in zip([False, *away], away, strict=False):
        if now and not before:
            lengths.append(0)
        if now:
            lengths[-1] += 1
    assert len(lengths) >= 3
    assert all(30 <= length <= 50 for length in lengths[:-1])  # 1.5 to 2.5 s
    assert 0.2 < sum(away) / ticks < 0.6


@pytest.mark.slow
def test_the_distracted_driver_misses_what_happens_meanwhile() -> None:
    """The same obstacle, at every tick of the first eight seconds: the delay is the reaction time, or up to a glance
    more."""
    reaction = round(DISTRACTED.reaction_s * TICKS_PER_SECOND)
    free = drive("distracted", [NOTHING] * 260, speed=2.0)
    delays: list[int] = []
    for appears in range(2, 160, 6):
        obstacle = things((2.0 * DT * appears + 12.0, 0.0, 0.0, 0.0))
        objects = [NOTHING] * appears + [obstacle] * (260 - appears)
        driven = drive("distracted", objects, speed=2.0)
        delays.append(next(tick for tick in range(260) if free[tick] != driven[tick]) - appears)
    assert min(delays) in (reaction, reaction + 1)
    assert reaction + 10 < max(delays) <= reaction + 52


@pytest.mark.parametrize("kind", DRIVER_KINDS)
def test_a_driver_is_the_same_by_seed_and_name(kind: str) -> None:
    traffic = [things(*((30.0 + 10 * i, 8.0 - 0.2 * t, -1.6, 4.0) for i in range(3))) for t in range(120)]
    assert drive(kind, traffic) == drive(kind, traffic)


def test_two_distracted_drivers_glance_at_different_times() -> None:
    one, other = (GlancePattern(DISTRACTED, seed) for seed in (1, 2))
    assert [one.is_away(t) for t in range(200)] != [other.is_away(t) for t in range(200)]


@pytest.mark.parametrize("kind", DRIVER_KINDS)
def test_hands_and_feet_are_no_faster_than_stated(kind: str) -> None:
    traffic = [things((20.0, 0.0, 0.0, 0.0)) if t % 60 > 30 else NOTHING for t in range(200)]
    controls = [Control(0.0, 0.0, 0.0), *drive(kind, traffic, speed=3.0)]
    step = 1.5 / AXIS_STEPS
    for before, after in itertools.pairwise(controls):
        assert abs(after.throttle - before.throttle) <= PEDAL_RATE * DT + step
        assert abs(after.brake - before.brake) <= PEDAL_RATE * DT + step
        assert abs(after.steer - before.steer) <= WHEEL_RATE * DT + step
        assert not (after.throttle and after.brake)
    assert any(control.brake for control in controls) and any(control.throttle for control in controls)


@given(st.floats(-50, 50), st.floats(-3, 3), st.floats(0, 20), st.floats(0, 3))
def test_what_was_seen_goes_straight_on(x: float, yaw: float, speed: float, elapsed_s: float) -> None:
    later = extrapolate(things((x, 1.0, yaw, speed)), elapsed_s)
    assert np.hypot(later.x[0] - x, later.y[0] - 1.0) == pytest.approx(speed * elapsed_s, abs=1e-9)
    assert later.yaw[0] == pytest.approx(yaw)


def test_impatient_drivers_drive_faster_and_closer() -> None:
    attentive, impatient = find_traits("attentive"), find_traits("impatient")
    assert impatient.speed_factor > attentive.speed_factor
    assert impatient.time_gap_s < attentive.time_gap_s and impatient.crossing_gap_s < attentive.crossing_gap_s
    slow, fast = (drive(kind, [NOTHING] * 60, speed=8.0)[-1] for kind in ("attentive", "impatient"))
    assert slow.throttle < fast.throttle


@pytest.mark.parametrize("has_view", [True, False])
def test_what_v2x_tells_is_seen_in_the_v2x_view_only(has_view: bool) -> None:
    """A car that stands on the road and is told of by its CAM, but not in sight."""
    drivers = [ScriptedDriver("attentive", has_view) for _ in range(2)]
    for driver in drivers:
        driver.start(briefing(straight(200.0)))
    differs = False
    for tick in range(40):
        cam = Cam(ReferencePose(40.0, 0.0, 0.0, tick), 0.0, 0.0, 0.0, 4.5, 1.8)
        told = replace(encode(cam), sender="other", tick=tick)
        state = own(x=SPEED * DT * tick, speed=SPEED)
        free, warned = drivers[0].act(seen(tick, state, NOTHING)), drivers[1].act(seen(tick, state, NOTHING, [told]))
        differs = differs or free != warned
    assert differs == has_view


def test_an_unknown_kind_is_one_sentence() -> None:
    with pytest.raises(InputError, match="expected one of attentive, distracted, impatient, found 'attentiv'; did you"):
        ScriptedDriver("attentiv", has_v2x_view=False)
