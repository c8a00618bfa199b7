"""Messages decoded once for all receivers."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.v2x.messages import (
    TYPES,
    Cpm,
    Direction,
    Intention,
    Mcm,
    MessageError,
    ReferencePose,
    decode,
    encode,
    find_problem,
)
from mdrive_sumo.v2x.shared_reading import decode_shared, find_shared_problem

POSE = ReferencePose(3.0, 4.0, 0.5, 7)
OBJECTS = Objects(("t00000001",), np.zeros(1, dtype=np.uint8), *np.arange(1.0, 7.0).reshape(6, 1))
CPM = Cpm(POSE, 60.0, OBJECTS, np.ones(1, dtype=np.uint8), sigmas=np.full((1, 3), 0.5))
MCM = Mcm(POSE, 5.0, Intention.KEEP, Direction.LEFT, 0.2, np.full((3, 2), 4.0), np.full((2, 2), 5.0))


def test_receivers_share_one_content_that_they_cannot_change() -> None:
    sent = encode(MCM)
    first = decode_shared(Message(sent.type, sent.payload, "a", 7))
    assert decode_shared(Message(sent.type, bytes(bytearray(sent.payload)), "b", 9)) is first
    assert isinstance(first, Mcm)
    with pytest.raises(ValueError, match="read-only"):
        first.planned[0] = 1.0


def test_the_content_is_that_of_decode() -> None:
    sent = encode(CPM)
    shared, expected = decode_shared(sent), decode(sent)
    assert isinstance(shared, Cpm)
    assert isinstance(expected, Cpm)
    assert (shared.pose, shared.range_m, shared.objects.ids) == (expected.pose, expected.range_m, expected.objects.ids)
    pairs = [(shared.age, expected.age), (shared.sigmas, expected.sigmas)]
    names = [field.name for field in fields(Objects) if field.name != "ids"]
    pairs += [(getattr(shared.objects, name), getattr(expected.objects, name)) for name in names]
    for one, other in pairs:
        assert np.array_equal(one, other)
        assert not one.flags.writeable


@given(st.sampled_from((*TYPES, "own")), st.binary(max_size=60))
def test_any_bytes_have_the_problem_that_they_have_alone(type_: str, payload: bytes) -> None:
    message = Message(type_, payload)
    assert find_shared_problem(message) == find_problem(message)
    try:
        expected = decode(message)
    except MessageError as error:
        with pytest.raises(MessageError) as raised:
            decode_shared(message)
        assert str(raised.value) == str(error)
    else:
        assert type(decode_shared(message)) is type(expected)
