"""What agents may answer, and what they may not; the same over the wire."""

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from testing.twins import compare_twins

from mdrive_sumo.agent_process import wire_protocol
from mdrive_sumo.contract import (
    CONTROL_STEP,
    STANDSTILL,
    Control,
    Detections,
    Gnss,
    Imu,
    Message,
    Note,
    Objects,
    Observation,
    OwnState,
    Plan,
    PointCloud,
    Raster,
    Reply,
    ReplyError,
    SensorSpec,
    check_reply,
    schema,
)

CONTROLLERS = frozenset(("tracker",))
good_plan = Plan(np.array([(1.0, 2.0), (2.0, 2.0)]), 0.2)


@pytest.mark.slow
@given(st.floats(0, 1), st.floats(0, 1), st.floats(-1, 1))
def test_controls_are_rounded_to_the_step_that_is_recorded(throttle: float, brake: float, steer: float) -> None:
    control = check_reply(Reply(control=Control(throttle, brake, steer)), CONTROLLERS).control
    assert control is not None
    for given_value, value in zip(
        (throttle, brake, steer), (control.throttle, control.brake, control.steer), strict=True
    ):
        assert abs(given_value - value) <= CONTROL_STEP / 2 + 1e-12
        assert value == round(value / CONTROL_STEP) * CONTROL_STEP or value == pytest.approx(round(value, 4), abs=0)


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (None, "expected a Reply, found NoneType"),
        ({"throttle": 1}, "expected a Reply, found dict"),
        (Reply(), "found neither"),
        (Reply(control=Control(0, 0, 0), plan=good_plan), "found both"),
        (Reply(control=Control(math.nan, 0, 0)), r"throttle: expected a number in \[0, 1\], found nan"),
        (Reply(control=Control(0, 1.01, 0)), r"brake: expected a number in \[0, 1\], found 1.01"),
        (Reply(control=Control(0, 0, -math.inf)), r"steer: expected a number in \[-1, 1\], found -inf"),
        (Reply(control=Control("fast", 0, 0)), "throttle: expected a number, found str"),
        (Reply(control=(0, 0, 0)), "expected a Control, found tuple"),
        (Reply(plan=[(0, 0)]), "expected a Plan, found list"),
        (Reply(plan=Plan(np.zeros((0, 2)), 0.2)), r"found \(0, 2\)"),
        (Reply(plan=Plan(np.zeros((3, 3)), 0.2)), r"found \(3, 3\)"),
        (Reply(plan=Plan(np.zeros((201, 2)), 0.2)), r"found \(201, 2\)"),
        (Reply(plan=Plan(np.array([(math.nan, 0)]), 0.2)), "finite points"),
        (Reply(plan=Plan(np.array([(1e7, 0)]), 0.2)), "finite points"),
        (Reply(plan=Plan(np.array([("a", "b")]), 0.2)), "expected numbers"),
        (Reply(plan=Plan(np.zeros((1, 2)), 0.0)), "interval_s"),
        (Reply(plan=Plan(np.zeros((1, 2)), math.nan)), "interval_s"),
        (Reply(plan=Plan(np.zeros((1, 2)), 0.2, "magic")), "unknown controller 'magic'"),
        (Reply(plan=Plan(np.zeros((1, 2)), 0.2, ["tracker"])), r"unknown controller \['tracker'\]"),
        (Reply(plan=Plan([(10**400, 0)], 0.2)), "expected numbers for points"),
        (Reply(plan=Plan(np.zeros((1, 2)), 10**400)), "expected numbers for points and interval_s"),
        (Reply(control=Control(10**400, 0, 0)), "throttle: expected a number, found int"),
        (Reply(STANDSTILL, detections=Detections([[10**400] * 5], [0.5])), "expected numbers for boxes and scores"),
        (Reply(control=Control(0, 0, 0), messages=("hello",)), "expected Message with a bytes payload, found str"),
        (Reply(control=STANDSTILL, messages=[]), "messages: expected a tuple of at most 64, found list"),
        (Reply(control=STANDSTILL, messages=(Message("text", b""),) * 65), "at most 64, found 65"),
        (Reply(control=STANDSTILL, messages=(Message("text", "hi"),)), "bytes payload"),
        (Reply(control=STANDSTILL, messages=(Message("a b", b""),)), "type: expected 1 to 16 of a-z, 0-9, _ and -"),
        (Reply(control=STANDSTILL, messages=(Message("x" * 17, b""),)), "type: expected 1 to 16"),
        (Reply(control=STANDSTILL, notes="why"), "notes: expected a tuple, found str"),
        (Reply(control=STANDSTILL, notes=(Note("Why?", ""),)), "notes: kind: expected 1 to 16"),
        (Reply(control=STANDSTILL, notes=(Note("why", "x" * 200_001),)), "at most 200000 characters a tick"),
    ],
)
def test_a_bad_answer_is_named(reply: object, message: str) -> None:
    with pytest.raises(ReplyError, match=message):
        check_reply(reply, CONTROLLERS)


def test_the_schema_is_data_and_names_every_type() -> None:
    data = json.loads(json.dumps(schema()))
    assert {"SensorSpec", "Briefing", "Observation", "Reply", "Plan", "Control", "Privileged"} <= set(data["types"])
    assert data["types"]["Reply"]["fields"] == {
        "control": "Control | null", "plan": "Plan | null", "messages": "tuple[Message]",
        "notes": "tuple[Note]", "detections": "Detections | null",
    }  # fmt: skip
    assert data["types"]["Objects"]["fields"]["x"] == "array[float64]"


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f), getattr(b, f)) for f in a.__dataclass_fields__)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if hasattr(a, "items"):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return bool(a == b)


def test_every_message_survives_the_wire() -> None:
    objects = Objects(("a", "é"), np.array([0, 3], dtype=np.uint8), *(np.arange(2.0) for _ in range(6)))
    own = OwnState(1, 2, 3, 4, 5, 6, 7)
    for message in (
        Observation(7, own, objects, {"tls:0": "r"}, (Message("CAM", b"\x00\xff", "1", 3),)),
        Reply(plan=good_plan, messages=(Message("text", b"hi"),), notes=(Note("why", "ü"),)),
        Observation(
            8,
            own,
            lidar={"roof": PointCloud(np.ones((3, 4), np.float32), np.array([-1, 0, 0], np.int32), ("t00000001",))},
            bev={"": Raster(("route",), np.full((1, 2, 2), 255, np.uint8), 0.5)},
            gnss=Gnss(1.0, 2.0, 3.0),
            imu=Imu((0.0, 0.0, 9.81), (0.0, 0.0, 0.1), 1.5),
            speedometer=4.0,
        ),
        (SensorSpec("objects", range_m=50.0, options={"fov": 1.0}),),
    ):
        assert same(message, wire_protocol.decode(wire_protocol.encode(message)))


@given(st.binary(max_size=200))
def test_garbage_on_the_wire_is_a_wire_error(data: bytes) -> None:
    try:
        value = wire_protocol.decode(data)
    except wire_protocol.WireError:
        return
    assert value is None or isinstance(value, bool | int | float | str | bytes | tuple | dict)


def test_an_array_of_objects_does_not_cross() -> None:
    with pytest.raises(wire_protocol.WireError, match="expected an array of one of"):
        wire_protocol.decode(wire_protocol.encode(np.array(["text"])))
    with pytest.raises(TypeError, match="found object"):
        wire_protocol.encode(object())


@given(
    arrays(np.float64, array_shapes(min_dims=0, min_side=0), elements=st.floats(allow_nan=True)),
    st.one_of(st.just(1e6), st.floats(allow_nan=True)),
)
def test_both_texts_say_alike_whether_numbers_are_within_a_limit(values: np.ndarray, limit: float) -> None:
    compare_twins("contract_reply_check_are_within", values, limit)
