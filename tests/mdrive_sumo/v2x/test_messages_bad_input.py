"""Damaged messages raise MessageError and nothing else; contents that do not fit are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.message_samples import HEADER, PLACE, cams, contents, cpm_with, cpms, denms, features, mcm_with, mcms

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.messages import (
    CAM,
    CPM,
    MAX_NAMES,
    MAX_OBJECTS,
    MAX_PAYLOAD_BYTES,
    MAX_POINTS,
    MAX_SECTORS,
    MAX_TEXT_BYTES,
    MCM,
    TEXT,
    TYPES,
    Cam,
    Content,
    Intention,
    MessageError,
    ReferencePose,
    decode,
    displace_message,
    encode,
    find_problem,
)


@pytest.mark.parametrize("kind", [*TYPES, "own"])
@given(payload=st.binary(max_size=120))
def test_random_bytes_raise_nothing_but_message_error(kind: str, payload: bytes) -> None:
    reads(Message(kind, payload))


@given(contents, st.data())
def test_damaged_messages_raise_nothing_but_message_error(content: Content, data: st.DataObject) -> None:
    whole = encode(content)
    payload = bytearray(whole.payload)
    for at in data.draw(st.lists(st.integers(0, max(8 * len(payload) - 1, 0)), max_size=6 if payload else 0)):
        payload[at // 8] ^= 1 << at % 8
    reads(Message(whole.type, bytes(payload)))
    reads(Message(whole.type, bytes(payload[: data.draw(st.integers(0, len(payload)))])))
    reads(Message(whole.type, bytes(payload) + b"\0"))


def reads(message: Message) -> bool:
    """Whether `decode` reads it; `find_problem` must say the same, and what is read must be usable and movable."""
    try:
        decode(message)
    except MessageError as error:
        assert message.type not in TYPES or find_problem(message)
        assert "\n" not in str(error) and str(error)
        return False
    assert find_problem(message) is None
    decode(displace_message(message, 1.0, -2.0, 0.5))
    return True


@pytest.mark.parametrize(("x", "y", "is_read"), [(990e3, -990e3, True), (-990.001e3, 0.0, False), (0.0, 2e7, False)])
def test_a_sender_beyond_all_maps_is_not_read(x: float, y: float, is_read: bool) -> None:
    message = encode(Cam(ReferencePose(x, y, 0.0, 0), 0.0, 0.0, 0.0, 4.0, 2.0))
    assert (find_problem(message) is None) == is_read
    if not is_read:
        with pytest.raises(MessageError, match="cam: expected a position within 990 km of the origin"):
            decode(message)


@given(st.one_of(cams(), cpms(), mcms(), denms(), features()))
def test_a_truncated_or_longer_message_is_not_read(content: Content) -> None:
    whole = encode(content)
    assert reads(whole)
    is_whole_shorter = isinstance(content, Cam) and content.path_history is not None and not len(content.path_history)
    assert reads(Message(whole.type, whole.payload[:-1])) == is_whole_shorter  # without its low-frequency container
    assert not reads(Message(whole.type, whole.payload + b"\1"))


def test_types_of_agents_own_need_only_fit() -> None:
    assert find_problem(Message("own", b"\xff" * MAX_PAYLOAD_BYTES)) is None
    assert find_problem(Message("own", b"\xff" * (MAX_PAYLOAD_BYTES + 1))) is not None
    with pytest.raises(MessageError, match="expected a type of"):
        decode(Message("own", b""))


def patched(content: Content, at: int, *values: int) -> Message:
    """The message with other bytes from there on."""
    whole = encode(content)
    return Message(whole.type, whole.payload[:at] + bytes(values) + whole.payload[at + len(values) :])


EMPTY_MCM = mcm_with()
NAMING_MCM = mcm_with(requests={"ab": Intention.STOP, "cd": Intention.STOP})
BODY = HEADER + 9
"""Where an MCM's lists begin: two of points, three of names."""


@pytest.mark.parametrize(
    "damaged",
    [
        patched(Cam(PLACE, 1.0, 0.0, 0.0, 4.0, 2.0), 0, 5),  # another kind
        patched(Cam(PLACE, 1.0, 0.0, 0.0, 4.0, 2.0), 0, 1),  # a CAM without standard deviations, as it once was
        patched(EMPTY_MCM, 0, 1),
        patched(cpm_with(), HEADER + 2, 2),  # more objects than there are
        patched(cpm_with(), HEADER + 4, 2),  # neither car nor road-side unit
        patched(cpm_with(), HEADER + 5 + 4, 4),  # no kind of object
        patched(EMPTY_MCM, HEADER + 2, 4),  # no intention
        patched(EMPTY_MCM, HEADER + 3, 6),  # no direction
        patched(EMPTY_MCM, HEADER + 4, 0),  # no time between points
        patched(EMPTY_MCM, BODY, MAX_POINTS + 1),
        patched(NAMING_MCM, BODY + 2, 3),  # more names than there are
        patched(NAMING_MCM, BODY + 4, 4),  # asked to do what is no intention
        patched(NAMING_MCM, BODY + 9, *b"ab"),  # the same name twice
        patched(NAMING_MCM, BODY + 5, 0xFF),  # no UTF-8
        Message(TEXT, b"x" * (MAX_TEXT_BYTES + 1)),
        Message(TEXT, b"\xff"),
        Message(CAM, b""),
        Message(CPM, encode(cpm_with()).payload[:HEADER]),
        Message(MCM, encode(EMPTY_MCM).payload[:HEADER]),
    ],
)
def test_a_byte_that_means_nothing_makes_a_message_unreadable(damaged: Message) -> None:
    assert not reads(damaged)


def test_only_the_patched_bytes_were_wrong() -> None:
    assert all(reads(encode(content)) for content in (EMPTY_MCM, NAMING_MCM, cpm_with()))
    assert NAMING_MCM.requests == getattr(decode(patched(NAMING_MCM, BODY + 9, *b"cd")), "requests", None)


FAR = np.array([[PLACE.x + 400.0, PLACE.y]])


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (Cam(ReferencePose(math.nan, 0.0, 0.0, 0), 0.0, 0.0, 0.0, 4.0, 2.0), "finite"),
        (Cam(ReferencePose(0.0, 0.0, math.inf, 0), 0.0, 0.0, 0.0, 4.0, 2.0), "cam"),
        (Cam(ReferencePose(0.0, 0.0, 0.0, -1), 0.0, 0.0, 0.0, 4.0, 2.0), "cam"),
        (Cam(PLACE, math.inf, 0.0, 0.0, 4.0, 2.0), "finite"),
        (Cam(PLACE, 0.0, 0.0, 0.0, 4.0, 2.0, math.nan), "finite"),
        (Cam(ReferencePose(0.0, 0.0, 0.0, 0, math.inf), 0.0, 0.0, 0.0, 4.0, 2.0), "finite"),
        (replace(cpm_with(2), sigmas=np.zeros((1, 3))), r"expected finite standard deviations of shape \(2, 3\)"),
        (replace(cpm_with(1), sigmas=np.full((1, 3), math.nan)), "finite standard deviations"),
        (cpm_with(MAX_OBJECTS + 1), "at most 255 objects"),
        (cpm_with(1, MAX_SECTORS + 1), "255 sectors"),
        (cpm_with(x=FAR[:, 0]), "within 327.67 m"),
        (cpm_with(x=np.array([math.nan])), "within 327.67 m"),
        (cpm_with(yaw=np.array([math.nan])), "finite"),
        (cpm_with(ids=("cav_1",)), "track names"),
        (cpm_with(kind=np.array([4], np.uint8)), "kinds"),
        (cpm_with(0, free_m=np.array([math.nan])), "finite"),
        (cpm_with(y=np.zeros(2)), "cpm"),
        (mcm_with(planned=FAR), "within 327.67 m"),
        (mcm_with(planned=np.full((MAX_POINTS + 1, 2), 100.0)), "at most 100 points"),
        (mcm_with(interval_s=0.0), "interval_s"),
        (mcm_with(interval_s=2.6), "interval_s"),
        (mcm_with(until_tick=2**32), "mcm"),
        (mcm_with(group=tuple(f"car_{i}" for i in range(MAX_NAMES + 1))), "at most 32 names"),
        (mcm_with(answers={"": True}), "1 to 80 bytes"),
        (mcm_with(requests={"x": 9}), "mcm"),
        ("x" * (MAX_TEXT_BYTES + 1), "8192 bytes"),
        ("\ud800", "text"),
    ],
)
def test_what_no_message_can_carry_is_refused(content: Content, why: str) -> None:
    with pytest.raises(MessageError, match=why):
        encode(content)
