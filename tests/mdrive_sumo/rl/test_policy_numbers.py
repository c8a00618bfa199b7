"""What a policy sees, does and hears, as numbers: worked by hand, and the same in every frame of reference."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.straight_route import make_own_state, make_straight_briefing

from mdrive_sumo.agents.learned import plan_anchors
from mdrive_sumo.agents.learned.ego_frame import convert_to_ego
from mdrive_sumo.contract import Briefing, Control, Message, Objects, Observation, OwnState
from mdrive_sumo.rl.driving_actions import TARGETS, make_pedals, make_plan_source, plan_along_route, read_target
from mdrive_sumo.rl.message_slots import LEARNED, MessageSlots, count_message_numbers
from mdrive_sumo.rl.observation_vector import (
    OBJECT_NUMBERS,
    OWN_NUMBERS,
    ROUTE_NUMBERS,
    RULE_NUMBERS,
    ObservationVector,
    count_numbers,
)
from mdrive_sumo.rl.route_cursor import RouteCursor
from mdrive_sumo.rl.slot_arrays import SlotArrays, SlotShape, count_bytes

BRIEFING = make_straight_briefing()


def _make_car(x: float, y: float, yaw: float, speed: float) -> Objects:
    columns = (np.array([value]) for value in (x, y, yaw, speed, 4.0, 2.0))
    return Objects(("b",), np.zeros(1, dtype=np.uint8), *columns)


def _write(briefing: Briefing, own: OwnState, users: Objects, nearest: int = 2) -> np.ndarray:
    out = np.full(count_numbers(nearest, 0, 0), np.nan, dtype=np.float32)
    vector = ObservationVector(briefing, RouteCursor(briefing), MessageSlots(0, 0), nearest)
    vector.write(Observation(0, own), own, users, out)
    return out


def test_an_observation_worked_by_hand() -> None:
    own = make_own_state(x=2.0, y=0.5, speed=8.0)
    out = _write(BRIEFING, own, _make_car(22.0, 4.5, math.pi / 2, 4.0))
    assert out[:OWN_NUMBERS] == pytest.approx([0.5, 0, 0, 0, 0.5 / 3.5, 0, 98 / 200, 1.0, 10 / 16])
    route = out[OWN_NUMBERS : OWN_NUMBERS + ROUTE_NUMBERS].reshape(-1, 3)
    assert route[:, 0] == pytest.approx([0.1, 0.2, 0.4, 0.6, 1.0])
    assert route[:, 1] == pytest.approx([-0.01] * 5)
    rules = out[OWN_NUMBERS + ROUTE_NUMBERS :][:RULE_NUMBERS]
    assert rules.tolist() == [4, 0, 0, 0, 4, 4, 4, 0]  # nothing ahead
    users = out[-2 * OBJECT_NUMBERS :].reshape(2, -1)
    assert users[0] == pytest.approx([1, 0.4, 0.08, 0, 1, -0.5, 0.25, 0.4, 0.8, 1, 0], abs=1e-6)
    assert not users[1].any()


@given(
    turn=st.floats(-3.0, 3.0),
    shift=st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000)),
    car=st.tuples(st.floats(-80, 80), st.floats(-80, 80), st.floats(-3, 3), st.floats(0, 20)),
)
def test_an_observation_is_the_same_in_every_frame(
    turn: float, shift: tuple[float, float], car: tuple[float, float, float, float]
) -> None:
    cos, sin = math.cos(turn), math.sin(turn)
    rotation = np.array(((cos, -sin), (sin, cos)))

    def move(x: float, y: float) -> tuple[float, float]:
        moved = rotation @ (x, y) + shift
        return float(moved[0]), float(moved[1])

    own = make_own_state(x=10.2, y=-0.4, yaw=0.1, speed=5.0)
    moved_own = replace(own, **dict(zip("xy", move(own.x, own.y), strict=True)), yaw=own.yaw + turn)
    briefing = replace(
        BRIEFING, route_xy=BRIEFING.route_xy @ rotation.T + np.array(shift), route_yaw=BRIEFING.route_yaw + turn
    )
    x, y, yaw, speed = car
    moved_car = _make_car(*move(x, y), yaw + turn, speed)
    assert _write(briefing, moved_own, moved_car) == pytest.approx(_write(BRIEFING, own, _make_car(*car)), abs=1e-4)


def test_pedals_and_steering() -> None:
    assert make_pedals(np.array((0.5, -0.25), np.float32)).control == Control(0.5, 0.0, -0.25)
    assert make_pedals(np.array((-1.0, 1.0), np.float32)).control == Control(0.0, 1.0, 1.0)


def test_targets() -> None:
    assert read_target("speed-offset", np.array((0.0, -1.0), np.float32)) == (8.0, -3.5)
    assert read_target("targets", np.array((14.0,), np.float32)) == TARGETS[14] == (12.0, 3.5)


def test_a_plan_reaches_speed_and_offset() -> None:
    plan = plan_along_route(RouteCursor(BRIEFING), make_own_state(x=10.0, speed=6.0), speed=8.0, offset=2.0)
    steps = np.diff(plan.points[:, 0]) / plan.interval_s
    assert steps[-1] == pytest.approx(8.0)
    assert np.diff(steps).max() <= 0.25 + 1e-9  # 2.5 m/s2
    assert plan.points[:, 1] == pytest.approx(np.arange(1, 21) * 0.1)  # two metres in two seconds
    stop = plan_along_route(RouteCursor(BRIEFING), make_own_state(x=10.0, speed=6.0), speed=0.0, offset=0.0)
    assert stop.points[-1, 0] == pytest.approx(13.3)  # 6 m/s, 0.5 m/s less every 0.1 s
    assert stop.points[-1, 0] == stop.points[-5, 0]


def test_a_plan_goes_on_beyond_the_route() -> None:
    cursor = RouteCursor(BRIEFING)
    for x in range(0, 100, 10):
        cursor.locate(make_own_state(x=float(x)))
    plan = plan_along_route(cursor, make_own_state(x=99.0, speed=8.0), speed=8.0, offset=0.0)
    assert plan.points[-1] == pytest.approx((115.0, 0.0))


@given(anchor=st.integers(0, plan_anchors.ANCHORS - 1), x=st.floats(0, 90), yaw=st.floats(-3, 3))
def test_an_anchor_stays_where_it_was_chosen(anchor: int, x: float, yaw: float) -> None:
    """Its points in the car's frame are those of the vocabulary, and ticks later the plan is the rest of the way."""
    own = make_own_state(x=x, yaw=yaw)
    source = make_plan_source("anchors", np.array((anchor,), np.float32), RouteCursor(BRIEFING), Observation(8, own))
    first, later = source(Observation(8, own)), source(Observation(18, make_own_state(x=x + 2.0)))
    assert convert_to_ego(first.points, own) == pytest.approx(plan_anchors.build_anchors().points[anchor], abs=1e-9)
    assert first.interval_s == 0.5
    assert later.points[:-1] == pytest.approx(first.points[1:], abs=1e-9)  # half a second later


def test_messages_keep_their_slots() -> None:
    slots = MessageSlots(senders=2, length=16)
    first, second, late = bytes(range(16)), b"\xff" * 16, b"\x01" * 16
    slots.add([Message(LEARNED, first, "b", 4), Message("cam", second, "c", 4), Message(LEARNED, b"short", "c", 4)])
    slots.add([Message(LEARNED, second, "c", 6), Message(LEARNED, late, "d", 6)])  # no slot is left for d
    out = np.zeros(count_message_numbers(2, 16), dtype=np.float32)
    slots.write(14, out)
    rows = out.reshape(2, 18)
    assert rows[0] == pytest.approx([1.0, 0.5, *(value / 255 for value in first)])
    assert rows[1] == pytest.approx([1.0, 0.4, *[1.0] * 16])
    slots.write(200, out)
    assert rows[:, 1].tolist() == [1.0, 1.0]
    assert count_message_numbers(3, 0) == 0


@given(
    shape=st.tuples(*[st.integers(0, 9)] * 4, st.tuples(*[st.integers(0, 5)] * 3)).map(lambda sizes: SlotShape(*sizes))
)
def test_arrays_over_one_memory_do_not_overlap(shape: SlotShape) -> None:
    arrays = SlotArrays.lay_out(shape, bytearray(count_bytes(shape)))
    for value, array in enumerate(arrays, start=1):
        array[:] = value
    assert all((array == value).all() for value, array in enumerate(arrays, start=1))
