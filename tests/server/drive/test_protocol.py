"""Bytes and messages between browser and server: what is sent is read back, and what is wrong costs one sentence."""

import json
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract.exchange import Control
from server.drive import messages, protocol
from server.drive.protocol import DriveInput, FrameState, InputDevice, ProtocolError, RowFlag, WireFrame

GOOD = DriveInput(InputDevice.GAMEPAD, 7, 1234.5, Control(0.25, 0.0, -1.0))


def test_sizes_are_those_of_the_page() -> None:
    assert (protocol.HEADER_BYTES, protocol.STATE_BYTES, protocol.ROW_BYTES, protocol.INPUT_BYTES) == (20, 80, 20, 28)
    assert protocol.ROW.fields is not None
    assert [protocol.ROW.fields[name][1] for name in protocol.ROW.names or ()] == [0, 2, 3, 4, 8, 12, 16]


def test_a_frame_is_read_back() -> None:
    rows = np.zeros(2, protocol.ROW)
    rows["name"], rows["flags"], rows["x"] = (3, 65_534), (RowFlag.BRAKING, 0), (1.5, -2e3)
    frame = WireFrame(FrameState.SLOW, 41, 3, 9, tuple(float(i) for i in range(10)), rows, {"factor": 0.9, "é": []})
    data = protocol.encode_frame(frame)
    assert data[:20] == struct.pack("<BBHIIII", 1, 3, 2, 41, 3, 9, len(b'{"factor":0.9,"\xc3\xa9":[]}'))
    read = protocol.decode_frame(data)
    assert (read.state, read.tick, read.take, read.ack, read.own) == (FrameState.SLOW, 41, 3, 9, frame.own)
    assert read.rows is not None
    assert (read.rows == rows).all()
    assert read.extra == {"factor": 0.9, "é": []}


def test_a_frame_for_spectators_has_no_state() -> None:
    read = protocol.decode_frame(protocol.encode_frame(WireFrame(FrameState.PAUSED, 0, 1, 0)))
    assert all(map(math.isnan, read.own))
    assert read.rows is not None
    assert (len(read.rows), read.extra) == (0, {})


@given(st.binary(max_size=200))
def test_any_bytes_are_a_frame_or_one_sentence(data: bytes) -> None:
    try:
        protocol.decode_frame(data)
    except (ProtocolError, ValueError) as error:
        assert "\n" not in str(error)


@given(
    st.sampled_from(InputDevice),
    st.integers(1, protocol.MAX_NUMBER),
    st.floats(0, 1, width=32),
    st.floats(0, 1, width=32),
    st.floats(-1, 1, width=32),
)
def test_an_input_is_read_back_in_steps_of_a_control(
    device: InputDevice, number: int, throttle: float, brake: float, steer: float
) -> None:
    read = protocol.decode_input(
        protocol.encode_input(DriveInput(device, number, 5.0, Control(throttle, brake, steer)))
    )
    assert (read.device, read.number) == (device, number)
    values = read.control.throttle, read.control.brake, read.control.steer
    for value, sent in zip(values, (throttle, brake, steer), strict=True):
        assert abs(value - sent) <= 0.5001e-4
        assert value == round(value, 4)


def pack(*values: object) -> bytes:
    return struct.pack("<BBHIdfff", *values)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "input: expected 28 bytes, found 0"),
        (pack(2, 0, 0, 1, 0.0, 0, 0, 0) + b"x", "input: expected 28 bytes, found 29"),
        (pack(1, 0, 0, 1, 0.0, 0, 0, 0), "input: expected bytes 2, device, 0, 0, found 1, 0, 0, 0"),
        (pack(2, 0, 1, 1, 0.0, 0, 0, 0), "input: expected bytes 2, device, 0, 0, found 2, 0, 1, 0"),
        (pack(2, 5, 0, 1, 0.0, 0, 0, 0), "input: device: expected 0 to 4, found 5"),
        (pack(2, 0, 0, 0, 0.0, 0, 0, 0), "input: number: expected 1 or more, found 0"),
        (pack(2, 0, 0, 1, math.nan, 0, 0, 0), "input: time: expected milliseconds, found nan"),
        (pack(2, 0, 0, 1, 0.0, math.nan, 0, 0), "input: throttle: expected a number in [0, 1], found nan"),
        (pack(2, 1, 0, 1, 0.0, 0, math.inf, 0), "input: brake: expected a number in [0, 1], found inf"),
        (pack(2, 1, 0, 1, 0.0, 0, -0.5, 0), "input: brake: expected a number in [0, 1], found -0.5"),
        (pack(2, 1, 0, 1, 0.0, 0, 0, -1.5), "input: steer: expected a number in [-1, 1], found -1.5"),
    ],
)
def test_a_wrong_input_costs_one_sentence(data: bytes, sentence: str) -> None:
    with pytest.raises(ProtocolError) as raised:
        protocol.decode_input(data)
    assert str(raised.value) == sentence


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        ({"do": "pause"}, messages.PauseRequest(do="pause")),
        ({"do": "rewind", "take": 3, "tick": 200}, messages.RewindRequest(do="rewind", take=3, tick=200)),
        (
            {"do": "hand-over", "cav": "ego_0", "to": "idm"},
            messages.HandOverRequest(do="hand-over", cav="ego_0", to="idm"),
        ),
        ({"do": "say", "text": " I yield. "}, messages.SayRequest(do="say", text="I yield.")),
        ({"do": "ping", "time": 12}, messages.PingRequest(do="ping", time=12.0)),
        (
            {"do": "what-if", "take": 1, "tick": 0, "agents": ["sharing"], "seconds": 5},
            messages.WhatIfRequest(do="what-if", take=1, tick=0, agents=["sharing"], seconds=5.0),
        ),
    ],
)
def test_requests_are_read(request_: object, expected: object) -> None:
    assert messages.decode_request(json.dumps(request_)) == expected


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "message: expected JSON, found other text"),
        ("[" * 4000, "message: expected JSON, found other text"),
        ('"pause"', 'message: expected an object with "do", found none'),
        ('{"do": 3}', 'message: expected an object with "do", found none'),
        (
            '{"do": "paus"}',
            "message: do: expected one of pause, resume, finish, leave, rewind, hand-over, say, what-if,"
            " ping, found 'paus'; did you mean 'pause'?",
        ),
        ('{"do": "pause", "now": true}', "pause: now: expected no such field, found 'True'"),
        ('{"do": "rewind", "take": 1}', "rewind: tick: expected a value, found none"),
        ('{"do": "rewind", "take": 1, "tick": -1}', "rewind: tick: expected greater than or equal to 0, found '-1'"),
        ('{"do": "rewind", "take": "1", "tick": 0}', "rewind: take: expected a valid integer, found '1'"),
        ('{"do": "ping", "time": NaN}', "ping: time: expected a finite number, found 'nan'"),
        ('{"do": "ping", "time": Infinity}', "ping: time: expected a finite number, found 'inf'"),
        (
            '{"do": "what-if", "take": 1, "tick": 0, "agents": ["a"], "seconds": 99}',
            "what-if: seconds: expected less than or equal to 30, found '99'",
        ),
        (
            '{"do": "what-if", "take": 1, "tick": 0, "agents": []}',
            "what-if: agents: expected at least one, found '[]'",
        ),
        ('{"do": "say", "text": "  "}', "say: text: expected at least one character, found '  '"),
        ('{"do": "say", "text": "a\\nb"}', "say: text: expected printable characters on one line, found 'a\\nb'"),
        ('{"do": "say", "text": "\\ud800"}', "say: text: expected text, found '\\ud800'"),
        ('{"do": "say", "text": "' + "x" * 201 + '"}', "say: text: expected at most 200 characters, found 201"),
        ('{"do": "say", "text": "' + "x" * 9000 + '"}', "message: expected at most 4096 characters, found 9025"),
    ],
)
def test_a_wrong_message_costs_one_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ProtocolError) as raised:
        messages.decode_request(text)
    assert str(raised.value) == sentence


@given(
    st.text(max_size=300)
    | st.builds(
        lambda word, more: json.dumps({"do": word, **more}),
        st.sampled_from([*messages.REQUESTS]),
        st.dictionaries(st.text(max_size=9), st.none() | st.floats() | st.text()),
    )
)
def test_any_text_is_a_request_or_one_sentence(text: str) -> None:
    try:
        messages.decode_request(text)
    except ProtocolError as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 400


def test_answers_name_what_they_are() -> None:
    waiting = messages.WaitingOut(waits_for=["ego_0"], absent=[], seconds=None)
    assert json.loads(messages.encode_answer(waiting)) == {
        "is": "waiting",
        "for": ["ego_0"],
        "absent": [],
        "seconds": None,
    }
    assert json.loads(messages.format_problem("no")) == {"is": "problem", "text": "no"}
