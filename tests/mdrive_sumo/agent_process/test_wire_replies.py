"""What an agent answers is read as hostile input: every abuse of the table, and random ones."""

import time

import hypothesis.strategies as st
import msgpack
import numpy as np
import pytest
from hypothesis import given
from testing.hostile_protocol import ANSWERS, GOOD, answer

from mdrive_sumo.agent_process import reply_decoding, wire_protocol
from mdrive_sumo.contract import Control, Message, Note, Plan, Reply, SensorSpec
from mdrive_sumo.loop.agent_driver import AgentFailure

TICK = 7


def read(data: bytes) -> Reply:
    return reply_decoding.read_reply(reply_decoding.decode_answer(data, TICK))


@pytest.mark.parametrize("name", ANSWERS)
def test_an_abuse_is_invalid(name: str) -> None:
    case = ANSWERS[name]
    assert case.data is not None
    begin = time.monotonic()
    with pytest.raises((reply_decoding.InvalidReplyError, AgentFailure)) as caught:
        read(case.data(TICK))
    text = str(caught.value)
    if isinstance(caught.value, reply_decoding.InvalidReplyError):
        text = f"act: {text}"
    assert text.startswith(case.text)
    assert len(text) < 400 and text.isprintable()
    assert time.monotonic() - begin < 5.0


@pytest.mark.parametrize(
    "reply",
    [
        Reply(control=Control(0.25, 0.0, -1.0)),
        Reply(plan=Plan(np.array([[1.0, 2.0], [3.0, 4.0]]), 0.2)),
        Reply(control=Control(1, 0, 0), messages=(Message("cam", b"\x00\xff"),), notes=(Note("llm", "said"),)),
    ],
    ids=("control", "plan", "messages"),
)
def test_a_good_reply_arrives_as_it_was_sent(reply: Reply) -> None:
    data = wire_protocol.encode_frame({"tick": TICK, "value": reply})[wire_protocol.LENGTH.size :]
    found = read(data)
    assert (found.control, found.messages, found.notes) == (reply.control, reply.messages, reply.notes)
    assert found.plan is None or (reply.plan is not None and found.plan.points.tolist() == reply.plan.points.tolist())


def test_numbers_of_numpy_and_lists_of_points_are_numbers() -> None:
    control = Control(np.float32(0.5), np.array(0.0), np.int64(1))
    assert read(wire_protocol.encode_frame({"tick": TICK, "value": Reply(control)})[4:]).control == Control(
        0.5, 0.0, 1.0
    )
    plan = Plan([(1, 2), (3, 4.5)], 0.2)
    found = read(wire_protocol.encode_frame({"tick": TICK, "value": Reply(plan=plan)})[4:]).plan
    assert found is not None and found.points.tolist() == [[1.0, 2.0], [3.0, 4.5]]


def test_the_channel_sets_the_sender() -> None:
    said = {"": "Message", "type": "cam", "payload": b"hi", "sender": "somebody-else", "tick": 99}
    assert read(answer(TICK, {**GOOD, "messages": [said]})).messages == (Message("cam", b"hi"),)


def test_what_an_agent_declares() -> None:
    specs = (SensorSpec("objects", range_m=30.0), SensorSpec("lidar", "top", options={"noise_m": 0.1, "hit_ids": True}))
    data = wire_protocol.encode_frame({"tick": -2, "value": {"label": "sharing", "sensors": specs}})[4:]
    assert reply_decoding.read_declaration(reply_decoding.decode_answer(data, -2)) == reply_decoding.AgentDeclaration(
        "sharing", specs
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"label": "single", "sensors": ()}, None),
        ({"label": 7, "sensors": ()}, "label: expected str, found int"),
        ({"label": "single"}, "what an agent declares: expected label, sensors, found"),
        ({"label": "single", "sensors": None}, r"sensors\(\): expected a tuple"),
        ({"label": "single", "sensors": ("lidar",)}, "expected a SensorSpec, found str"),
        ({"label": "single", "sensors": (SensorSpec("x"),) * 65}, r"sensors\(\): expected a tuple of at most 64"),
        ({"label": "single", "sensors": (SensorSpec("x", options={"a": None}),)}, "option 'a': expected a number"),
        ({"label": "single", "sensors": (SensorSpec("x", range_m=True),)}, "range_m: expected a number, found bool"),
        ("single", "what an agent declares: expected a mapping, found str"),
    ],
)
def test_what_an_agent_may_not_declare(value: object, text: str | None) -> None:
    data = wire_protocol.encode_frame({"tick": -2, "value": value})[4:]
    if text is None:
        reply_decoding.read_declaration(reply_decoding.decode_answer(data, -2))
    else:
        with pytest.raises(reply_decoding.InvalidReplyError, match=text):
            reply_decoding.read_declaration(reply_decoding.decode_answer(data, -2))


def test_a_joint_agent_answers_for_the_cavs_it_was_asked_about() -> None:
    def told(egos: dict[str, object]) -> object:
        return reply_decoding.decode_answer(wire_protocol.encode_frame({"tick": 1, "value": egos})[4:], 1)

    assert list(reply_decoding.read_replies_by_ego(told({"b": None, "a": None}), ("a", "b"))) == ["b", "a"]
    with pytest.raises(reply_decoding.InvalidReplyError, match="expected replies for a, b"):
        reply_decoding.read_replies_by_ego(told({"a": None}), ("a", "b"))
    with pytest.raises(reply_decoding.InvalidReplyError, match="expected a tuple of at most 2"):
        reply_decoding.read_replies_by_ego(told({"a": None, "b": None, "c": None}), ("a", "b"))


scalars = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=8)
)
keys = st.sampled_from(
    ("", "tick", "value", "control", "plan", "messages", "notes", "throttle", "points", "data", "shape")
)
names = st.sampled_from(("Reply", "Control", "Plan", "array", "map", "Message", "Note", "<f8"))
values = st.recursive(
    scalars | names,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys, inner | names, max_size=6),
    max_leaves=20,
)


@given(values)
def test_anything_is_a_reply_or_refused_with_a_reason(value: object) -> None:
    for data in (msgpack.packb(value), answer(TICK, value), answer(TICK, {**GOOD, "plan": value, "control": None})):
        try:
            found = read(data)
        except (reply_decoding.InvalidReplyError, reply_decoding.AgentCrashError, AgentFailure) as error:
            assert str(error).isprintable()
        else:
            assert isinstance(found, Reply)


@given(st.binary(max_size=64))
def test_any_bytes_are_an_answer_or_refused(data: bytes) -> None:
    with pytest.raises((reply_decoding.InvalidReplyError, reply_decoding.AgentCrashError)):
        reply_decoding.decode_answer(data, TICK)
